"""Pictures drawn from logs. May import gazempc.results."""
