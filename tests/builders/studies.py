"""Small comparisons and sweeps, and their output."""

import csv

import pytest
import yaml

from experiments.aggregate import TIMING
from experiments.compare import CompareSettings, runs_of
from experiments.sweep.plan import load_plan
from gazempc.errors import SettingsError

SMALL = {
    "name": "small",
    "recordings": ["subject01_R1", "subject02_R4"],
    "base": {"controller": "lookahead", "predictor": "constant_velocity"},
    "vary": {"model.dead_time_scale": [0.5, 1], "lookahead.smoothing_time_s": [0, 0.1]},
}


def written(folder, content):
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "sweep.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def words(folder, content, *more):
    return [str(written(folder, content)), "--out", str(folder / "out"), "--no-figures", "--jobs", "1", *more]


def runs(out, **changes):
    """Labels and jobs of a small comparison."""
    plain = {
        "recordings": ("subject01_R1", "subject01_R4", "subject02_R6"),
        "controllers": ("reactive", "lookahead", "mpc+perfect"),
    }
    return runs_of(CompareSettings(**plain | changes, out=out))


def rows_of(out, name="results.csv"):
    """The rows of a table without computing times."""
    with (out / name).open(newline="") as file:
        return [{k: v for k, v in row.items() if k not in TIMING} for row in csv.DictReader(file)]


def refusal(folder, content):
    with pytest.raises(SettingsError) as caught:
        load_plan(written(folder, content))
    return str(caught.value)
