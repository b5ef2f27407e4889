"""One page of HTML that tells a result to a stranger, complete in one file. May import gazempc.results."""
