"""File formats of recordings, one per module. May import gazempc.recordings."""
