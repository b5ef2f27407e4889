"""Reports as one self-contained HTML page. May import gazempc.results."""
