"""What a run leaves: log, metrics, report, figures. May import recordings and neck, never what makes a run."""
