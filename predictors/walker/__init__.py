"""The default predictor: its inputs, its networks and the uncertainty that it states. May import `predictors` only."""
