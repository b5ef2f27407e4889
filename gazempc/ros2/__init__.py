"""ROS 2: a polled node of rclpy, stamps, and frames of tf. May import gazempc.errors."""
