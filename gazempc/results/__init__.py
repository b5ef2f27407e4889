"""What a run leaves: log, metrics, report, figures. May import gazempc.recordings and neck."""
