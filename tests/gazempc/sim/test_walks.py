"""End-to-end replays of real people. The recordings are not part of the project; see `walks_dir`."""

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
    """The first clip of each person and group: every second turn, every eighth straight walk."""
    with (walks_dir / "index.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    first = {(row["subject"], row["group"]): row for row in reversed(rows)}
    turns = [row for (_, group), row in first.items() if group != "straight"]
    straight = [row for (_, group), row in first.items() if group == "straight"]
    return turns[::2] + straight[::8]


def measured(walks_dir):
    """The metrics by group, controller and clip; the two known extremes on every second clip."""
    found = {}
    for k, row in enumerate(clips(walks_dir)):
        try:
            placed = place(load(walks_dir / f"{row['clip']}.csv"), "side", 2.5, 1.2)
        except PlacementError:
            continue
        chosen = CONTROLLERS if k % 2 == 0 else ("lookahead", "mpc")
        found |= {(row["group"], name, row["clip"]): measure(replayed(placed, name)) for name in chosen}
    return found


def mean_rms(results, controller, group=None):
    values = [m.gaze_error_rms_deg for (g, c, _), m in results.items() if c == controller and group in {None, g}]
    return float(np.mean(values))


# Mean gaze error of the clips chosen above as measured, RMS, degrees: two straight ones, a turn and a sharp one. A
# seventh more is a change for the worse: an experiment that pays moves it by less, and a fault by more.
MEASURED_DEG = {
    ("lookahead", "straight"): 0.99,
    ("lookahead", "turn"): 0.72,
    ("lookahead", "sharp"): 2.75,
    ("mpc", "straight"): 0.89,
    ("mpc", "turn"): 0.83,
    ("mpc", "sharp"): 2.79,
    ("mpc+perfect", None): 0.18,
}


def test_gaze_errors_on_real_walks_are_as_measured(walks_dir):
    """As measured: 12.7 deg without prediction; on the face for 2.6 % of the time, with prediction for 94 %."""
    results = measured(walks_dir)
    means_deg = {(controller, group): mean_rms(results, controller, group) for controller, group in MEASURED_DEG}
    assert [key for key, mean_deg in means_deg.items() if mean_deg >= 1.15 * MEASURED_DEG[key]] == [], means_deg
    assert mean_rms(results, "reactive") == pytest.approx(12.7, rel=0.15)
    assert all(m.limit_violations == 0 for m in results.values())

    def contact(controller):
        return np.mean([m.eye_contact_2p6 for (_, c, _), m in results.items() if c == controller])

    assert contact("reactive") < 0.03
    assert min(contact("lookahead"), contact("mpc")) > 0.88
