"""The neck: its file, its kinematics and its servos. May import errors, types and settings files."""
