"""Start of `python -m experiments.sweep`."""

from gazempc.signals import start

if __name__ == "__main__":
    start("sweep", "experiments.sweep.sweep")
