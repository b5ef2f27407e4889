"""A neck of Dynamixel motors. May import gazempc.robots."""
