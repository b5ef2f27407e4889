"""Errors of a simulated sensor, one subject a module: the fields of its file, random processes, errors, times, view."""
