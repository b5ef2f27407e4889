"""Recorded walks: read, generated, placed beside a robot; the true head. May import gazempc.files."""
