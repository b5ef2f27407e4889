"""Real people, end to end. These recordings are not part of the project; see `walks_dir`."""

import csv

import numpy as np
import pytest
from builders.replays import replayed

from gazempc.errors import PlacementError
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.results.metrics import measure

pytestmark = pytest.mark.slow

# The whole folder takes minutes.
CONTROLLERS = ("reactive", "lookahead", "mpc", "mpc+perfect")


def clips(walks_dir):
    """The first clip of each person and group: of every other who turns, and of every eighth who walks straight."""
    with (walks_dir / "index.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    first = {(row["subject"], row["group"]): row for row in reversed(rows)}
    turns = [row for (_, group), row in first.items() if group != "straight"]
    straight = [row for (_, group), row in first.items() if group == "straight"]
    return turns[::2] + straight[::8]


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
    return float(np.mean(values))


# Mean gaze error of the clips chosen above as measured, RMS, degrees: two straight ones, a turn and a sharp one. A
# seventh more is a change for the worse: an experiment that pays moves it by less, and a fault by more.
MEASURED_DEG = {
    ("lookahead", "straight"): 1.02,
    ("lookahead", "turn"): 0.98,
    ("lookahead", "sharp"): 3.05,
    ("mpc", "straight"): 0.95,
    ("mpc", "turn"): 1.07,
    ("mpc", "sharp"): 3.03,
    ("mpc+perfect", None): 0.17,
}


@pytest.mark.parametrize(("controller", "group"), MEASURED_DEG)
def test_the_gaze_errs_as_little_as_measured(results, controller, group):
    assert mean_rms(results, controller, group) < 1.15 * MEASURED_DEG[controller, group]


def test_who_only_reacts_errs_by_the_delay(results):
    """13.7 deg as measured, ten times as much as with prediction; no limit is ever violated."""
    assert mean_rms(results, "reactive") == pytest.approx(13.7, rel=0.15)
    assert all(m.limit_violations == 0 for m in results.values())


def test_a_reactive_gaze_is_hardly_ever_on_the_face_and_a_predictive_one_nearly_always(results):
    """1.3 %, 92 % and 90 % of the time as measured."""

    def contact(controller):
        return np.mean([m.eye_contact_2p6 for (_, c, _), m in results.items() if c == controller])

    assert contact("reactive") < 0.03
    assert min(contact("lookahead"), contact("mpc")) > 0.88
