"""Standard filters to compare with. May import `predictors` only."""
