"""Start of `python -m experiments.paper`."""

from experiments.engine.signals import start

if __name__ == "__main__":
    start("paper", "experiments.paper.reproduction")
