"""People who cross, and crowds: whose identities are kept. May import experiments.engine."""
