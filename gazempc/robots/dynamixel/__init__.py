"""A neck of two Dynamixel motors."""
