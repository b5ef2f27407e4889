"""Start of `python -m experiments.people`."""

from gazempc.signals import start

if __name__ == "__main__":
    start("people", "experiments.people.study")
