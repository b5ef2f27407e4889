"""Benchmarks: medians and 99th percentiles of one run, ratios inside it; never part of a timed test."""
