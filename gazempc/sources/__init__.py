"""Where observations come from in a live run."""
