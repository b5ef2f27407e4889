"""Gaze shifts of head and eyes. May import experiments.engine."""
