"""Predictive gaze: forecast a walking person's head and turn the robot's neck in time."""
