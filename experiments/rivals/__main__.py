"""Start of `python -m experiments.rivals`."""

from gazempc.signals import start

if __name__ == "__main__":
    start("rivals", "experiments.rivals.comparison")
