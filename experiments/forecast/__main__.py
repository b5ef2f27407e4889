"""Start of `python -m experiments.forecast`."""

from gazempc.signals import start

if __name__ == "__main__":
    start("forecast", "experiments.forecast.command")
