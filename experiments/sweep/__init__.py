"""Sweeps of settings: the sweep file, its points, the runs, tables and figures. May import experiments.engine."""
