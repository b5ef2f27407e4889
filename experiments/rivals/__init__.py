"""Control laws that robots and cameras run, in one simulation with ours. May import experiments.engine."""
