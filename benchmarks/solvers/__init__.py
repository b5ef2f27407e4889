"""The MPC's problem, alternative solvers, and their timing. May import benchmarks and gazempc."""
