"""Start of `python -m experiments.rivals`."""

from experiments.engine.signals import start

if __name__ == "__main__":
    start("rivals", "experiments.rivals.comparison")
