"""Pictures of what sensors see of a walk. May import experiments.engine."""
