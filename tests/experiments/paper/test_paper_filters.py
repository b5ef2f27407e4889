"""Sample sizes implied by the paper's statistics, the filter's time constant, and straight-line error on turns."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from scipy.stats import norm

from experiments.paper.filters import sweep, turn_error_m, turn_needed_rad, turns_needed
from experiments.paper.frames import acceleration_psd
from experiments.paper.published import PUBLISHED, implied_frames, rank_biserial


def printed_p(statistic, n, digits):
    """One-tailed p value of a signed-rank sum by the normal approximation, as printed."""
    mean, variance = n * (n + 1) / 4, n * (n + 1) * (2 * n + 1) / 24
    return f"{norm.sf((statistic - mean) / np.sqrt(variance)):.{digits - 1}e}"


def test_the_printed_statistics_imply_2808_and_2734_frames_and_at_least_1582():
    implied = {p.group: implied_frames(p) for p in PUBLISHED}
    assert (implied["R34"].fewest, implied["R34"].most) == (2808, 2808)
    assert (implied["R56"].fewest, implied["R56"].most) == (2734, 2734)
    assert (implied["R12"].fewest, implied["R12"].most) == (1582, None)
    assert implied["R34"].thinned_p_value == pytest.approx(6.8e-8, rel=0.01)
    assert implied["R56"].thinned_p_value == pytest.approx(0.22, abs=0.005)
    assert np.isnan(implied["R12"].thinned_p_value)
    assert implied["R34"].per_video == pytest.approx(2808 / 28)
    assert implied["R12"].per_video == pytest.approx(1582 / 28)
    for p in PUBLISHED[1:]:  # adjacent sizes do not round to the printed p value
        fits = {n for n in range(2600, 3000) if printed_p(p.statistic, n, 3) == f"{p.p_value:.2e}"}
        assert fits == {implied[p.group].fewest}


def test_the_opposite_tail_of_the_published_straight_route_test():
    """Half of the possible rank sums lie above the printed one: the baseline error is smaller."""
    straight = implied_frames(PUBLISHED[0])
    assert straight.worse_p_value == pytest.approx(0.0048, abs=1e-4)
    assert straight.effect[1] < straight.effect[0] < 0
    for n in (10, 57):
        total = n * (n + 1) / 2
        assert rank_biserial(total, n) == pytest.approx(1.0)
        assert rank_biserial(0.0, n) == -1.0
        assert rank_biserial(total / 2, n) == pytest.approx(0.0)


FRAME_S = 1 / 30


@pytest.mark.parametrize("time_s", [0.4, 1.0, 2.0])
def test_natural_frequency_and_damping_of_the_steady_state_filter(time_s):
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
    """A row of a job: all along x; twice the error against the true position, thrice after 1 s."""
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
    labels = ("filter_time_s", "against", "horizon_s", "group")
    table = {tuple(r[name] for name in labels): r for r in sweep(rows)}
    assert len(table) == 2 * 2 * 2 + 2 * 2
    row = table[0.1, "filtered", 0.5, "R12"]
    assert row["baseline_mm"] == pytest.approx(200)
    # Sum: 600 + 200 w + |800 w - 400| has its minimum at 0.5.
    assert row["weight"] == pytest.approx(0.5, abs=1e-5)
    assert row["error_at_weight_mm"] == pytest.approx(700 / 3, abs=0.01)
    other = table[0.1, "filtered", 0.5, "R34"]
    assert (other["baseline_mm"], other["error_at_weight_mm"]) == pytest.approx((400, 0), abs=0.01)
    assert other["weight"] == row["weight"]
    assert table[0.1, "true", 0.5, "R12"]["baseline_mm"] == pytest.approx(400)
    assert table[0.1, "filtered", 1.0, "R12"]["baseline_mm"] == pytest.approx(600)
    assert table[0.1, "true", 1.0, "R34"]["baseline_mm"] == pytest.approx(2400)
    assert table[1.0, "filtered", 0.5, "R12"]["weight"] == 0.0


@given(way_m=st.floats(0.05, 2.0), turn_rad=st.floats(-6.0, 6.0, allow_subnormal=False))
def test_straight_line_error_equals_the_integrated_arc(way_m, turn_rad):
    """The arc in 4000 short steps, each in the direction at its middle."""
    direction = turn_rad * (np.arange(4000) + 0.5) / 4000
    end = way_m / 4000 * np.array([np.cos(direction).sum(), np.sin(direction).sum()])
    assert turn_error_m(way_m, turn_rad) == pytest.approx(np.hypot(end[0] - way_m, end[1]), abs=1e-6)


@given(way_m=st.floats(0.05, 2.0), turn_rad=st.floats(1e-6, 4.08))
def test_the_turn_needed_is_the_inverse(way_m, turn_rad):
    needed = turn_needed_rad(way_m, turn_error_m(way_m, turn_rad))
    assert turn_error_m(way_m, needed) == pytest.approx(turn_error_m(way_m, turn_rad), abs=1e-9)
    assert needed == pytest.approx(turn_rad, rel=1e-3, abs=1e-6) or turn_rad > 4.0  # flat near the maximum


def test_turns_needed_by_hand():
    rows = [
        {"group": "straight", "speed_m_s": [1.0, 1.2, 1.4], "turn_deg": [-10.0, 2.0, 4.0]},
        {"group": "straight", "speed_m_s": [2.0, 2.0], "turn_deg": [0.0, -6.0]},
        {"group": "sharp", "speed_m_s": [0.5], "turn_deg": [50.0]},
        {"group": "elsewhere", "speed_m_s": [9.0], "turn_deg": [90.0]},
        {"group": "straight"},
    ]
    straight, sharp = turns_needed(rows)
    assert (straight["group"], straight["speed_m_s"], straight["turn_median_deg"]) == ("R12", 1.4, 4.0)
    assert straight["turn_p95_deg"] == pytest.approx(6 + 0.8 * 4)  # linear between the 4th and the 5th of five
    assert turn_error_m(0.7, np.radians(straight["turn_needed_deg"])) == pytest.approx(0.122)
    assert sharp["group"] == "R56"
    assert sharp["turn_needed_deg"] is None  # 559 mm on a path of 250 mm
