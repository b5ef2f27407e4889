"""Several people: tracks, attention, looks away. May import gazempc.neck and predictors."""
