"""Files that anybody may have made: checked, read within bounds, written whole. May import gazempc.errors."""
