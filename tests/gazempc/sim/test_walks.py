"""Real people, end to end. These recordings are not part of the project; see `walks_dir`."""

import csv

import numpy as np
import pytest
from builders.replays import replayed

from gazempc.errors import PlacementError
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.results.metrics import measure
from gazempc.run import main

# One clip of every person and group, and all sharp turns: the whole folder takes minutes.
CONTROLLERS = ("reactive", "lookahead", "mpc", "perfect")


def clips(walks_dir):
    with (walks_dir / "index.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    first = {(row["subject"], row["group"]): row for row in reversed(rows)}
    return list(first.values())


@pytest.fixture(scope="module")
def results(walks_dir):
    found = {}
    for row in clips(walks_dir):
        try:
            placed = place(load(walks_dir / f"{row['clip']}.csv"), "side", 2.5, 1.2)
        except PlacementError:
            continue
        for name in CONTROLLERS:
            log = replayed(placed, name)
            found[row["group"], name, row["clip"]] = measure(log)
    return found


def mean_rms(results, controller, group=None):
    values = [m.gaze_error_rms_deg for (g, c, _), m in results.items() if c == controller and group in {None, g}]
    assert values
    return float(np.mean(values))


def test_prediction_cuts_the_error_of_straight_walks_at_least_threefold(results):
    reactive = mean_rms(results, "reactive", "straight")
    assert mean_rms(results, "lookahead", "straight") < reactive / 3
    assert mean_rms(results, "mpc", "straight") < reactive / 3


def test_perfect_foresight_errs_at_most_0p3_deg(results):
    assert mean_rms(results, "perfect") <= 0.3


def test_a_reactive_gaze_is_hardly_ever_on_the_face(results):
    contact = [m.eye_contact_2p6 for (_, c, _), m in results.items() if c == "reactive"]
    assert np.mean(contact) < 0.1


def test_prediction_helps_in_every_group(results):
    for group in ("straight", "turn", "sharp"):
        for controller in ("lookahead", "mpc"):
            assert mean_rms(results, controller, group) < mean_rms(results, "reactive", group) / 2


def test_no_limit_is_ever_violated(results):
    assert all(m.limit_violations == 0 for m in results.values())


def test_a_walk_by_path_from_the_command_line(walks_dir, tmp_path, capsys):
    path = walks_dir / "cmu16_trial17.csv"
    words = ["--replay", str(path), "--controllers", "reactive", "mpc", "--no-figures", "--out", str(tmp_path)]
    assert main(words) == 0
    assert "motion capture" in capsys.readouterr().out
