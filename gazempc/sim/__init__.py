"""Simulation: sensor model, neck model, replay of recordings. May import gazempc.loop."""
