"""A neck simulated by MuJoCo. May import gazempc.robots."""
