"""Where observations come from in a live run, one source a module. May import gazempc.live."""
