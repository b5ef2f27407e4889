"""The model-predictive controller: program, solvers, and what it aims at. May import gazempc.controllers."""
