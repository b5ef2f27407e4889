"""The synthetic data set: gait, routes, room. May import gazempc.recordings."""
