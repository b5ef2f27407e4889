"""What arrives in a live run, looked at each second: clock, unit, axes, plausibility, rate and ids."""
