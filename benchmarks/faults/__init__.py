"""What a live run does under attacks and faults. May import gazempc."""
