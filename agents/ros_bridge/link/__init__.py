"""Connections to ROS 2, by whatever transport."""
