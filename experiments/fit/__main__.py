"""Start of `python -m experiments.fit`."""

from experiments.engine.signals import start

if __name__ == "__main__":
    start("fit", "experiments.fit.command")
