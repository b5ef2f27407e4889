"""Stability margins of controller, observer and dead time. May import gazempc.controllers and gazempc.loop."""
