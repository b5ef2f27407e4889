"""The control loop: predictor, controller, smoother, robot. May import gazempc.controllers, people, robots, results."""
