"""What a turn costs who goes straight on, against the arc."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.paper.turns import turn_error_m, turn_needed_rad, turns_needed


@given(way_m=st.floats(0.05, 2.0), turn_rad=st.floats(-6.0, 6.0, allow_subnormal=False))
def test_error_of_going_straight_on_by_walking_the_arc(way_m, turn_rad):
    """The arc in 4000 short steps, each in the direction at its middle."""
    direction = turn_rad * (np.arange(4000) + 0.5) / 4000
    end = way_m / 4000 * np.array([np.cos(direction).sum(), np.sin(direction).sum()])
    assert turn_error_m(way_m, turn_rad) == pytest.approx(np.hypot(end[0] - way_m, end[1]), abs=1e-6)


@given(way_m=st.floats(0.05, 2.0), turn_rad=st.floats(1e-6, 4.08))
def test_the_turn_needed_is_the_inverse(way_m, turn_rad):
    needed = turn_needed_rad(way_m, turn_error_m(way_m, turn_rad))
    assert turn_error_m(way_m, needed) == pytest.approx(turn_error_m(way_m, turn_rad), abs=1e-9)
    assert needed == pytest.approx(turn_rad, rel=1e-3, abs=1e-6) or turn_rad > 4.0  # flat near the largest


def test_no_turn_makes_any_error():
    largest = max(turn_error_m(1.0, turn) for turn in np.linspace(0, 7, 7001))
    assert turn_error_m(1.0, 0.0) == 0.0
    assert turn_needed_rad(0.6, 0.6 * largest + 1e-4) is None
    assert turn_needed_rad(0.6, 0.6 * largest - 1e-4) is not None
    assert turn_needed_rad(0.0, 0.1) is None
    # A quarter turn: the person ends at 2/pi of the way along both axes.
    assert turn_error_m(1.0, np.pi / 2) == pytest.approx(np.hypot(1 - 2 / np.pi, 2 / np.pi))


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
    assert sharp["turn_needed_deg"] is None  # 559 mm on a way of 250 mm
