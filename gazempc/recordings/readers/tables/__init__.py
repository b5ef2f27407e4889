"""Tables as programs export them: layouts, and what columns mean. May import gazempc.recordings."""
