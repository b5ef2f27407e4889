"""Walks at other paces, as fast and as long as was wanted; variants of standing people stay near their place."""

import numpy as np
import pytest
from builders.fits import speeds, straight_walk

from experiments.fit.pace import at_pace
from experiments.fit.trackers import beside


def test_starts_and_stops_lead_from_the_spot_to_a_walk_and_back_and_who_stands_stays():
    along = np.array([np.cos(0.4), np.sin(0.4)])
    for seed in range(3):
        rng = np.random.default_rng(seed)
        starts, stops, stands = (at_pace(straight_walk(12.0), kind, rng) for kind in ("start", "stop", "stand"))
        way_m = (starts.head_m[:, :2] - starts.head_m[0, :2]) @ along
        assert np.abs(way_m[:18]).max() < 0.45  # leans, steps aside
        assert speeds(starts, 0.3)[-1] > 0.4
        assert way_m[-1] > 0.5
        assert speeds(stops, 0.3)[:10].mean() > 0.4
        assert np.ptp(stops.head_m[-10:, :2], axis=0).max() < 0.35
        assert stops.times_s[-1] == pytest.approx(5.0, abs=0.04)
        assert 0.002 < np.ptp(stands.head_m[:, :2], axis=0).max() < 1.5
        assert speeds(stands, 0.3).max() < 1.5


def test_the_robot_stands_beside_the_walk_and_nobody_walks_through_it():
    walk, bearings = straight_walk(4.0), []
    for seed in range(20):
        moved = beside(walk, np.random.default_rng(seed))
        away = np.linalg.norm(moved.head_m[:, :2], axis=1)
        assert away.min() > 1.2 - 1e-9
        np.testing.assert_allclose(np.diff(moved.head_m, axis=0), np.diff(walk.head_m, axis=0), atol=1e-12)
        np.testing.assert_allclose(moved.head_m[:, 2], walk.head_m[:, 2] - 1.2)
        bearings.append(np.arctan2(*moved.head_m[60, 1::-1]))
    assert np.ptp(bearings) > 5.0
