"""Live runs in real time: sources of observations, mount of the sensor, run. May import gazempc.sim, margins."""
