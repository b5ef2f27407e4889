"""Fit of the predictor `walker`. May import experiments.engine."""
