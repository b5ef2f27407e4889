"""The MPC's problem, several ways to solve it, and their figures. May import benchmarks and gazempc."""
