"""A run on the real clock: sources of observations, the sensor's mount, the run. May import gazempc.sim, margins."""
