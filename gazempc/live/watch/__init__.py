"""What arrives in a live run, checked each second: clock, unit, axes, rate and ids. May import gazempc.live."""
