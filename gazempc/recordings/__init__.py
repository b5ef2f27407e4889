"""Recorded walks: readers, synthetic walks, placement of the robot, true head position. May import gazempc.files."""
