"""Comparisons and studies made with gazempc; nothing imports this package. May import gazempc."""
