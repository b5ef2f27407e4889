"""A run on the real clock: sources of observations, the sensor's mount, the run itself. May import gazempc.sim, margins."""
