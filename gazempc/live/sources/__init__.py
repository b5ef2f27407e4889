"""Sources of observations of a live run, one a module. May import gazempc.live."""
