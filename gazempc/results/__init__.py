"""Results of a run: log, metrics, report, figures. May import gazempc.recordings and neck."""
