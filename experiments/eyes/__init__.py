"""Head and eyes in one program, to compare the cascade with. May import experiments.engine."""
