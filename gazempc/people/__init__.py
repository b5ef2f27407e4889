"""Several people: a track each, whom to look at, when to look away. May import gazempc.neck and predictors."""
