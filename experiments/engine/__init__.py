"""One engine for all jobs over many recordings: cache, workers, progress, stop, resume. May import gazempc."""
