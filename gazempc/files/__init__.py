"""Files from untrusted sources: checked, read within bounds, written whole. May import gazempc.errors."""
