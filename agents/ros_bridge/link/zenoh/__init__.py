"""Connection to nodes under rmw_zenoh_cpp, over a Zenoh session of its own."""
