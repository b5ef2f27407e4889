"""The synthetic data set: gait and routes. May import gazempc.recordings."""
