"""Benchmarks: medians and 99th percentiles of one run, ratios inside it. May import all packages."""
