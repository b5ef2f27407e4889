"""Robots: the interface, and one robot a file or folder. May import neck and ros2."""
