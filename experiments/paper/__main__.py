"""Start of `python -m experiments.paper`."""

from gazempc.signals import start

if __name__ == "__main__":
    start("paper", "experiments.paper.reproduction")
