"""Services that answer questions to the memory, and drivers for arms and cameras that speak ROS."""
