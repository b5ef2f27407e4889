"""The model-predictive controller: optimal control problem, condensing, solver. May import gazempc.controllers."""
