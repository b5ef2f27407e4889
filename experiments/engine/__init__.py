"""Jobs over many recordings: cache, workers, progress, stop and resume. May import `gazempc` only."""
