"""Execution of jobs over many recordings: cache, worker pool, progress, resumption. May import gazempc."""
