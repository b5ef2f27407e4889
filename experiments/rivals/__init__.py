"""Control laws of existing robots and cameras, in one simulation with this project's. May import experiments.engine."""
