"""The agent between ROS and the memory: a module for each concept and direction."""
