"""Several people: a track each, whom to look at, and when to look away."""
