"""ROS 2: a node of rclpy that is asked for its messages, stamps, and frames of tf. May import gazempc.errors."""
