"""Our side against real ROS 2: nodes of rclpy in an environment of their own (`make test-ros`), as processes."""
