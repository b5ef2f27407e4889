"""Gaze aversion, switches of attention and engagement. May import experiments.engine."""
