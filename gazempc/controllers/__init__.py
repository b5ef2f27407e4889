"""Controllers: map a forecast to a plan of commands. May import gazempc.neck and predictors."""
