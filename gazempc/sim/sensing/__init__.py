"""Errors of a simulated sensor, one subject a module. May import gazempc.recordings and gazempc.neck."""
