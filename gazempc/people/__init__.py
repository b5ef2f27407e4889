"""Several people: tracking, attention, gaze aversion. May import gazempc.neck and predictors."""
