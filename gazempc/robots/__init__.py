"""Robots: the interface, and one robot a file or folder. May import gazempc.neck and ros2."""
