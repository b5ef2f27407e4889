"""The head of Reachy Mini."""
