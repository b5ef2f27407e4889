"""Viewers of a live run, and MCAP files for them. May import gazempc.live."""
