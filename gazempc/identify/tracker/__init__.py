"""Errors of a tracker, measured from a recording of it. May import gazempc.live."""
