"""Files from untrusted sources: checks, bounded reading, atomic writing. May import gazempc.errors."""
