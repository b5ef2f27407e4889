"""The filter's time constant, and the sweep over filters by hand."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from experiments.paper.filters import sweep
from experiments.paper.frames import (
    acceleration_psd,
)

FRAME_S = 1 / 30


@pytest.mark.parametrize("time_s", [0.4, 1.0, 2.0])
def test_the_steady_filter_has_this_natural_frequency_and_damping(time_s):
    """Poles of the steady-state Kalman filter by Riccati's equation."""
    F, H = np.array([[1.0, FRAME_S], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    Q = acceleration_psd(time_s) * np.array([[FRAME_S**3 / 3, FRAME_S**2 / 2], [FRAME_S**2 / 2, FRAME_S]])
    R = np.array([[0.01**2]])
    P = solve_discrete_are(F.T, H.T, Q, R)
    K = P @ H.T / (H @ P @ H.T + R)
    poles = np.log(np.linalg.eigvals((np.eye(2) - K @ H) @ F).astype(complex)) / FRAME_S
    np.testing.assert_allclose(np.abs(poles), 1 / time_s, rtol=0.06)
    np.testing.assert_allclose(-poles.real / np.abs(poles), np.sqrt(0.5), rtol=0.06)


def made_row(group, subject, base_m, turn_m):
    """A row as `execute` makes it: all along x; twice the error against the true position, thrice after 1 s."""
    horizons = [
        {
            "filtered": [[k * b, 0.0, 0.0] for b in base_m],
            "true": [[2 * k * b, 0.0, 0.0] for b in base_m],
            "turn": {"paper": {"turn_m": [[t, 0.0, 0.0] for t in turn_m], "yaw_deg": [None] * len(base_m)}},
        }
        for k in (1, 3)
    ]
    labels = {"recording": f"{subject}_{group}", "source": "made", "subject": subject, "group": group}
    return {**labels, "failed": None, "left_out": None, "horizons": horizons}


def test_the_sweep_by_hand():
    rows = {
        0.1: [made_row("straight", "a", [0.1, 0.2, 0.3], [0.1, 0.0, 0.1]), made_row("turn", "b", [-0.4], [0.8])],
        1.0: [made_row("straight", "a", [0.5], [0.0])],
    }
    table = {(r.filter_time_s, r.against, r.horizon_s, r.group): r for r in sweep(rows)}
    assert len(table) == 2 * 2 * 2 + 2 * 2
    row = table[0.1, "filtered", 0.5, "R12"]
    assert row.baseline_mm == pytest.approx(200)
    # Together: 600 + 200 w + |800 w - 400| is least at 0.5.
    assert row.weight == pytest.approx(0.5, abs=1e-5)
    assert row.error_at_weight_mm == pytest.approx(700 / 3, abs=0.01)
    other = table[0.1, "filtered", 0.5, "R34"]
    assert (other.baseline_mm, other.error_at_weight_mm) == pytest.approx((400, 0), abs=0.01)
    assert other.weight == row.weight
    assert table[0.1, "true", 0.5, "R12"].baseline_mm == pytest.approx(400)
    assert table[0.1, "filtered", 1.0, "R12"].baseline_mm == pytest.approx(600)
    assert table[0.1, "true", 1.0, "R34"].baseline_mm == pytest.approx(2400)
    assert table[1.0, "filtered", 0.5, "R12"].weight == 0.0
