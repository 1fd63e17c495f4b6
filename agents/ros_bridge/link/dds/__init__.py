"""Connection to nodes under DDS."""
