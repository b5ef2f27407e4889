"""Tables exported by programs: layouts, and mappings of columns. May import gazempc.recordings."""
