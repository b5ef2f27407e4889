"""The neck: its file, its kinematics and its servos. May import gazempc.specfiles."""
