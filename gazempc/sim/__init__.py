"""Simulation: what a sensor sees of a recording, the simulated neck, a replay in simulated time. May import loop."""
