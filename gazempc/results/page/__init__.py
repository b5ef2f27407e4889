"""Reports as one page of HTML, complete in one file. May import gazempc.results."""
