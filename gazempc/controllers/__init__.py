"""Controllers: each turns a forecast of the head into a plan of commands. May import neck and predictors."""
