"""Control laws that robots and cameras run today, beside ours, in one simulation."""
