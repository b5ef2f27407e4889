"""The head of Reachy Mini, and its body. May import gazempc.robots."""
