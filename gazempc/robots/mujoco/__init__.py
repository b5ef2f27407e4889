"""A neck simulated by MuJoCo."""
