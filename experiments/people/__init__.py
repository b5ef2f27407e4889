"""People who cross and crowds: whose identities are kept; `python -m experiments.people`."""
