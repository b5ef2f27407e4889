"""Tables of looks away, switches and engagement."""

import numpy as np
import pytest
from builders.attention import attention_log, error_in
from scipy.optimize import brentq

from experiments.people import study
from experiments.people.standing import least_time_s
from experiments.people.study import decided
from gazempc.neck.spec import load_neck


def cells(text):
    """Rows of the tables in a text, heads and rules left out."""
    rows = [
        [cell.strip() for cell in line.strip("| ").split("|")] for line in text.splitlines() if line.startswith("|")
    ]
    heads = [k - 1 for k, row in enumerate(rows) if set(row) == {"---"}]
    return [row for k, row in enumerate(rows) if k not in heads and set(row) != {"---"}]


PLANNED = ((2.0, 3.0, "listening"), (6.0, 8.0, "listening"))


@pytest.fixture
def talks(monkeypatch):
    """Talks without a replay: looks away of 1 s and 2 s, each back 0.1 s late."""
    log = attention_log(error_in(10.0, 15.0, (0.0, 2.0), (3.1, 6.0), (8.1, 10.1)), away=PLANNED)
    monkeypatch.setattr(study, "talk", lambda *_: log)
    monkeypatch.setattr(study, "return_late_s", lambda *_: [0.01, 0.02, np.inf])


@pytest.mark.usefixtures("talks")
def test_the_tables_of_returns_have_each_controller_standing_and_walking():
    rows = cells(study.return_table(6))
    assert [row[:2] for row in rows[:5]] == [
        *([name, "reference"] for name in ("reactive", "lookahead", "mpc", "mpc+perfect")),
        ["mpc", "slow"],
    ]
    assert all(float(late) == pytest.approx(100.0, abs=6.0) for _, _, late, _ in rows[:5])
    assert rows[5] == ["reactive", "reference", "20", "never", "3", "1"]


@pytest.mark.slow
def test_engagement_on_recordings_is_right_for_at_least_95_percent_of_the_decided_time(bags_dir):
    found = decided(bags_dir)
    assert found.right_s + found.wrong_s > 60.0
    assert found.right_s / (found.right_s + found.wrong_s) >= 0.95


def test_the_least_time_is_that_of_the_fastest_motion():
    """Without a limit of velocity or jerk half of the way is speeding up: angle = a t^2 / 4."""
    neck = load_neck("reference")
    limits = {"velocity_max_rad_s": 900.0, "acceleration_max_rad_s2": 10.0, "jerk_max_rad_s3": 1e8}
    quick = neck.model_copy(update={"pan": neck.pan.model_copy(update=limits)})
    acceleration = float(quick.command_limits.acceleration_max_rad_s2[0])
    turn_rad, cone_rad = np.deg2rad([60.0, 2.6])
    whole_s = 2.0 * np.sqrt(turn_rad / acceleration)
    arrives_s = brentq(lambda t: 0.5 * acceleration * (whole_s - t) ** 2 - cone_rad, 0.0, whole_s)
    lag_s = neck.pan.dead_time_s + neck.pan.servo_lag_s
    assert least_time_s(quick, 60.0) - lag_s == pytest.approx(arrives_s, abs=0.003)
