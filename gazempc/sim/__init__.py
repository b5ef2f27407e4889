"""Simulation: what a sensor sees of a recording, the simulated neck, a replay. May import gazempc.loop."""
