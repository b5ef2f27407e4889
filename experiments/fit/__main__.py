"""Start of `python -m experiments.fit`."""

from gazempc.signals import start

if __name__ == "__main__":
    start("fit", "experiments.fit.command")
