"""The head of Reachy Mini, and its body."""
