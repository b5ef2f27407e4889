"""The validation of Tamaru et al. 2021 (arXiv 2103.06417), section V. May import experiments.engine."""
