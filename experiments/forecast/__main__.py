"""Start of `python -m experiments.forecast`."""

from experiments.engine.signals import start

if __name__ == "__main__":
    start("forecast", "experiments.forecast.command")
