"""Controllers: each turns a forecast into a plan of commands. May import gazempc.neck and predictors."""
