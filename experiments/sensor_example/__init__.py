"""Pictures of what sensors see of a walk."""
