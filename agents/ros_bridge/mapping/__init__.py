"""Pure functions between messages of ROS 2 and data of the graph, one module a concept."""
