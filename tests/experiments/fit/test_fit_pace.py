"""Walks at other paces, as fast and as long as was wanted; variants of standing people stay near their place."""

import numpy as np
import pytest
from builders.fits import FRAME_S, speeds, straight_walk

from experiments.fit import pace
from experiments.fit.pace import at_pace, prolong, vary_standing
from experiments.fit.variants import GaplessWalk


def profiles(monkeypatch, speed_of):
    monkeypatch.setattr(pace, "_profile", lambda kind, t, rng: speed_of(t))


@pytest.mark.parametrize(("wanted_m_s", "own_m_s"), [(0.5, 1.4), (0.9, 1.0), (2.0, 1.4)])
def test_the_walk_has_the_speed_that_is_wanted(monkeypatch, wanted_m_s, own_m_s):
    profiles(monkeypatch, lambda t: np.full(t.size, wanted_m_s))
    walk = straight_walk(12.0, own_m_s, sway_m=0.02)
    found = at_pace(walk, "steady", np.random.default_rng(0))
    np.testing.assert_allclose(speeds(found)[20:-20], wanted_m_s, rtol=0.05, atol=0.03)
    across = found.head_m[:, :2] @ [-np.sin(0.4), np.cos(0.4)]
    across -= across.mean()
    assert across.max() < 0.06  # on the same path, gait and what sway is added included
    assert found.times_s[-1] - found.times_s[0] <= 5.0


@pytest.mark.parametrize("seed", range(4))
def test_a_start_leads_from_the_spot_to_a_usual_speed(seed):
    found = at_pace(straight_walk(12.0), "start", np.random.default_rng(seed))
    along = (found.head_m[:, :2] - found.head_m[0, :2]) @ [np.cos(0.4), np.sin(0.4)]
    assert np.abs(along[:18]).max() < 0.45  # leans, steps aside
    assert speeds(found, 0.3)[-1] > 0.4
    assert along[-1] > 0.5


@pytest.mark.parametrize("seed", range(4))
def test_a_stop_leads_from_a_walk_to_the_spot(seed):
    found = at_pace(straight_walk(12.0), "stop", np.random.default_rng(seed))
    assert speeds(found, 0.3)[:10].mean() > 0.4
    assert np.ptp(found.head_m[-10:, :2], axis=0).max() < 0.35
    assert found.times_s[-1] == pytest.approx(5.0, abs=0.04)


def test_a_stand_stays_on_the_spot_with_leans_and_turns():
    found = [at_pace(straight_walk(4.0), "stand", np.random.default_rng(seed)) for seed in range(40)]
    spans_m = np.array([np.ptp(walk.head_m, axis=0) for walk in found])
    assert spans_m[:, :2].min() > 0.002
    assert spans_m[:, :2].max() < 1.5
    assert np.median(spans_m[:, :2]) < 0.3
    assert max(speeds(walk, 0.3).max() for walk in found) < 1.5
    turned_rad = [np.ptp(walk.pelvis_yaw_rad) for walk in found]
    assert np.sum(np.array(turned_rad) > 0.5) > 3


@pytest.mark.parametrize("heading_rad", [0.0, 2.5])
def test_a_prolonged_walk_is_straight_and_keeps_speed_and_gait(heading_rad):
    walk = straight_walk(3.0, heading_rad=heading_rad)
    long = prolong(walk, 9.0)
    assert long.times_s[-1] - long.times_s[0] == pytest.approx(9.0)
    np.testing.assert_allclose(np.diff(long.times_s), FRAME_S)
    along = long.head_m[:, :2] @ [np.cos(heading_rad), np.sin(heading_rad)]
    across = long.head_m[:, :2] @ [-np.sin(heading_rad), np.cos(heading_rad)]
    slope = np.polyfit(long.times_s, np.stack([along, across], axis=1), 1)[0]
    np.testing.assert_allclose(slope, [1.2, 0.0], atol=0.03)
    assert np.abs(across - across.mean()).max() < 0.06
    assert np.std(across[-60:]) == pytest.approx(np.std(across[:60]), rel=0.4)
    assert long.head_m[:, 2].mean() == pytest.approx(1.6, abs=0.005)
    assert np.abs(long.pelvis_yaw_rad - (heading_rad + 0.1)).max() < 0.1
    assert np.abs(long.head_yaw_rad - (heading_rad - 0.05)).max() < 0.06


@pytest.mark.parametrize("seed", range(3))
def test_a_varied_person_stays_near_where_they_stood(seed):
    """RegimeMotion about the mean is scaled by 0.4 to 1.5 and played at 0.7 to 1.35 of its pace."""
    t = np.arange(240) * FRAME_S
    head_m = np.stack([0.1 * np.sin(2 * t), 0.05 * np.cos(2 * t), 1.6 + 0.0 * t], axis=1)
    own = GaplessWalk(t, head_m, 0.5 * np.sin(t), np.sin(t))
    found = vary_standing(own, np.random.default_rng(seed))
    assert found.times_s[-1] - found.times_s[0] <= 6.0 + 1e-9
    assert 0.4 * 0.15 < np.ptp(found.head_m[:, 0]) < 1.5 * 0.21
    assert speeds(found, 0.1).max() < 1.5 * 1.35 * 0.21
    assert np.ptp(found.pelvis_yaw_rad) <= 1.0 + 1e-9
