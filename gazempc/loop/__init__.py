"""Predictor, controller, smoother and robot in one loop. May import gazempc.controllers, people, robots, results."""
