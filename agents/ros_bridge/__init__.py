"""Bridge to ROS 2 without an installation of ROS: messages, connections, and what maps to what."""
