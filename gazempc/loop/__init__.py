"""The loop joins predictor, controller, smoother and robot. May import controllers, robots and results."""
