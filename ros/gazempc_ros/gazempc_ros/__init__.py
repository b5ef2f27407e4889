"""Nodes of ROS 2 around `gazempc.Gaze`."""
