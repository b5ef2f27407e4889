"""The gaze MPC's problem, several ways to solve it, and their figures; see `benchmarks.mpc_solvers`."""
