"""Trackers through which walks are seen in a fit: drawn as they are said to be, and seen through as they are."""

from collections import Counter

import numpy as np
import pytest
from builders.fits import straight_walk

from experiments.fit.trackers import KINDS, beside, draw_tracker, seen_through
from gazempc.sim.sensor import SensorSpec


def drawn(walks, n=400):
    return [draw_tracker(np.random.default_rng(seed), walks) for seed in range(n)]


def plain_sensor(**fields):
    return SensorSpec.model_validate({"name": "here", "source": "test", "rate_hz": 30.0, "latency_s": 0.0} | fields)


def test_every_kind_is_drawn_as_often_as_is_said():
    plain, other = (Counter(kind for kind, _ in drawn(walks)) for walks in ("plain", "other"))
    assert set(plain) == set(KINDS) - {"street"}
    assert set(other) == set(KINDS) - {"jumps"}
    assert plain["white"] == pytest.approx(0.54 * 400, rel=0.25)
    assert other["street"] == pytest.approx(0.40 * 400, rel=0.25)


def test_the_street_sees_no_heights_and_no_orientations():
    kinds = [draw_tracker(np.random.default_rng(seed), "other") for seed in range(60)]
    streets = [sensor for kind, sensor in kinds if kind == "street"]
    assert len(streets) > 10
    walk = straight_walk(2.0, sway_m=0.0)
    walk.head_m[:, 2] = 1.6
    for seed, sensor in enumerate(streets[:10]):
        seen = seen_through(walk, "street", sensor, np.random.default_rng(seed))
        assert all(o.head_quat_wxyz is None and o.pelvis_quat_wxyz is None for o in seen)
        np.testing.assert_allclose([o.head_position_base_m[2] for o in seen], 1.6, atol=1e-9)
    own = [seen_through(walk, "street", plain_sensor(), np.random.default_rng(seed)) for seed in range(20)]
    error = np.array([[o.head_position_base_m for o in each] for each in own]) - walk.head_m
    sizes = error[:, :, :2].std(axis=(1, 2))
    assert 0.003 < sizes.min() < 0.02
    assert 0.02 < sizes.max() < 0.06
    # It wanders: errors of two frames in a row are alike.
    assert np.mean(error[:, 1:, :2] * error[:, :-1, :2]) > 0.5 * np.mean(error[:, :, :2] ** 2)


@pytest.mark.parametrize("rate_hz", [7.5, 15.0, 25.0, 30.0, 50.0, 60.0])
def test_a_tracker_without_errors_sees_the_walk_at_its_rate(rate_hz):
    walk = straight_walk(3.0)
    seen = seen_through(walk, "white", plain_sensor(rate_hz=rate_hz), np.random.default_rng(0))
    times_s = np.array([o.capture_time_s for o in seen])
    assert np.median(np.diff(times_s)) == pytest.approx(1.0 / rate_hz, rel=0.25)
    assert len(seen) == pytest.approx(3.0 * rate_hz, abs=2.0 + 0.05 * rate_hz)
    expected = np.stack([np.interp(times_s, walk.times_s, axis) for axis in walk.head_m.T], axis=1)
    np.testing.assert_allclose([o.head_position_base_m for o in seen], expected, atol=0.002)
    yaws = [2.0 * np.arctan2(o.head_quat_wxyz[3], o.head_quat_wxyz[0]) for o in seen]
    np.testing.assert_allclose(yaws, np.interp(times_s, walk.times_s, walk.head_yaw_rad), atol=1e-3)


def test_the_robot_stands_beside_the_walk_and_nobody_walks_through_it():
    walk, bearings = straight_walk(4.0), []
    for seed in range(50):
        moved = beside(walk, np.random.default_rng(seed))
        away = np.linalg.norm(moved.head_m[:, :2], axis=1)
        assert away.min() > 1.2 - 1e-9
        np.testing.assert_allclose(np.diff(moved.head_m, axis=0), np.diff(walk.head_m, axis=0), atol=1e-12)
        np.testing.assert_allclose(moved.head_m[:, 2], walk.head_m[:, 2] - 1.2)
        bearings.append(np.arctan2(*moved.head_m[60, 1::-1]))
    assert np.ptp(bearings) > 5.0
