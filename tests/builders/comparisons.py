"""Small comparisons, and what they have written."""

import csv

from experiments.aggregate import TIMING
from experiments.compare import CompareSettings, runs_of


def settings(out, **changes):
    values = {
        "recordings": ("subject01_R1", "subject01_R4", "subject02_R6"),
        "controllers": ("reactive", "lookahead", "mpc+perfect"),
        "jobs": 2,
        "out": out,
        "figures": False,
    }
    return values | changes


def runs(out, **changes):
    return runs_of(CompareSettings(**settings(out, **changes)))


def rows_of(out):
    with (out / "results.csv").open(newline="") as file:
        return [{k: v for k, v in row.items() if k not in TIMING} for row in csv.DictReader(file)]
