"""Looks away, switches and engagement. May import experiments.engine."""
