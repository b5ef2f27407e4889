"""Accuracy of the camera source on rendered images. May import gazempc."""
