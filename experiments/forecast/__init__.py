"""Comparison of forecasts over many recordings. May import experiments.engine."""
