"""Rate, jitter and losses, from stamps of which all is known."""

import numpy as np
import pytest

from gazempc.identify.tracker.timing import frame_times

GRID_S = np.arange(600) / 30.0


@pytest.mark.parametrize("late_s", [np.zeros(600), np.where(np.arange(600) % 7 == 3, 0.025, 0.0)])
def test_late_frames_are_not_lost(late_s):
    found = frame_times(GRID_S + late_s)
    assert found.regular
    assert (found.single_share, found.gaps_s.size) == (0.0, 0)
    assert found.rate_hz == pytest.approx(30.0, rel=1e-3)
    assert found.jitter_s == pytest.approx(np.diff(GRID_S + late_s).std(), rel=1e-6, abs=1e-9)


def test_single_losses_and_gaps_are_told_apart():
    lost = np.zeros(600, dtype=bool)
    lost[[20, 60, 200, 250, 400, 450, 500, 550]] = True
    lost[101:113] = lost[301:307] = True
    rng = np.random.default_rng(0)
    found = frame_times((GRID_S + 0.002 * rng.standard_normal(600))[~lost])
    assert found.single_share == pytest.approx(8 / 600)
    assert found.gaps_s == pytest.approx([12 / 30, 6 / 30], rel=1e-3)
    assert found.rate_hz == pytest.approx(30.0, rel=1e-3)
    assert found.gap_interval_s == pytest.approx((GRID_S[-1] - 18 / 30) / 2, rel=1e-2)


def test_an_irregular_tracker_loses_nothing():
    intervals_s = np.random.default_rng(1).uniform(1 / 30, 1 / 4, 400)
    intervals_s[200] = 2.0
    found = frame_times(np.cumsum(intervals_s))
    assert not found.regular
    assert found.single_share == 0.0
    assert found.gaps_s == pytest.approx([2.0 - np.median(intervals_s)], rel=1e-4)
    assert found.rate_hz == pytest.approx(1.0 / np.delete(intervals_s, 200).mean(), rel=1e-3)
