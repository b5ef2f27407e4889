"""File formats of recordings, one a module. May import gazempc.recordings."""
