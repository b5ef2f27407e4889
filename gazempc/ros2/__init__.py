"""ROS 2 messages without ROS: on the wire, and a node that sends and takes them. May import gazempc.errors."""
