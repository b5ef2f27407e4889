"""Errors of the range: measured where they are large, and kept away from the direction of the gaze."""

import numpy as np
import pytest
from builders.trackers import seen_m, wander
from builders.walkers import straight_model

from predictors import HeadObservation, Walker
from predictors.walker.range_error import MeasuredRange

STEP_S = 1.0 / 30.0


def walk_m(times_s):
    """Past the robot at 2.5 m, with sway and bob."""
    sway, bob = 0.02 * np.sin(2 * np.pi * 0.95 * times_s), 0.02 * np.sin(2 * np.pi * 1.9 * times_s)
    return np.stack([2.5 + sway, 1.2 * (times_s - times_s[-1] / 2), 0.4 + bob], axis=1)


def measured(times_s, positions_m):
    """The variance after each frame."""
    found = MeasuredRange()
    variances_m2 = []
    for time_s, position_m in zip(times_s.tolist(), positions_m, strict=True):
        found.learn(HeadObservation(time_s, position_m))
        variances_m2.append(found.variance_m2())
    return found, np.array(variances_m2)


@pytest.mark.parametrize("rate_hz", [10.0, 60.0])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_white_error_of_the_range_is_measured(rate_hz, jitter):
    rng, n = np.random.default_rng(0), 400
    times_s = (np.arange(n) + jitter * rng.uniform(-0.5, 0.5, n)) / rate_hz
    standing_m = np.tile([2.0, 1.5, 0.0], (n, 1))
    _, variances_m2 = measured(times_s, seen_m(rng, standing_m, times_s, along=(0.15, 0.0, 1.0)))
    # The drift counts four times, and it is found by chance where there is none.
    assert 0.9 * 0.375 < np.sqrt(np.median(variances_m2[50:])) < 1.6 * 0.375


@pytest.mark.parametrize("noise_m", [0.0, 0.01])
def test_usual_trackers_have_no_error_of_the_range(noise_m):
    """Gait is not taken for one, and nor is white error in all directions."""
    rng, times_s = np.random.default_rng(1), np.arange(300) * STEP_S
    _, variances_m2 = measured(times_s, walk_m(times_s) + noise_m * rng.standard_normal((300, 3)))
    assert np.sqrt(variances_m2.max()) < 0.03


def test_a_drift_counts_more_than_its_steps():
    """Its steps from frame to frame are 0.03 m; in a fifth of a second it goes twice as far."""
    rng, times_s = np.random.default_rng(3), np.arange(300) * STEP_S
    drift = wander(rng, times_s, 0.1, 4.0)
    _, variances_m2 = measured(times_s, walk_m(times_s) * (1.0 + drift))
    assert np.sqrt(np.median(variances_m2[60:])) > 0.04


def test_the_covariance_lies_along_the_line_of_sight():
    rng, times_s = np.random.default_rng(4), np.arange(60) * STEP_S
    found, variances_m2 = measured(times_s, seen_m(rng, walk_m(times_s), times_s, along=(0.15, 0.0, 1.0)))
    sight = np.array([2.0, -1.0, 2.0]) / 3.0
    covariance_m2 = found.covariance_m2(2.7 * sight)
    np.testing.assert_allclose(covariance_m2, variances_m2[-1] * np.outer(sight, sight), rtol=1e-12)
    assert not found.covariance_m2(np.zeros(3)).any()


@pytest.mark.parametrize("every_s", [2 * STEP_S, 1.8])
def test_another_person_now_and_then_is_no_error_of_the_range(every_s):
    """Also where the two take turns in each frame. The other one is 1 m to the left."""
    rng, times_s = np.random.default_rng(8), np.arange(300) * STEP_S
    seen_m = walk_m(times_s) + 0.01 * rng.standard_normal((300, 3))
    left = np.stack([-seen_m[:, 1], seen_m[:, 0], np.zeros(300)], axis=1)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    _, variances_m2 = measured(times_s, seen_m + left * (times_s % every_s > 0.6 * every_s)[:, None])
    assert np.sqrt(variances_m2.max()) < 0.05


def test_the_direction_is_forecast_through_ranges_that_are_wrong_in_each_frame():
    """If the error were taken for one in all directions, this would be 1.4 to 3.4 deg."""
    rng, times_s = np.random.default_rng(6), np.arange(90) * STEP_S
    true_m = walk_m(times_s)
    walker, off_deg = Walker(straight_model()), []
    seen = seen_m(rng, true_m, times_s, along=(0.15, 0.0, 1.0), across_deg=(0.1, 0.0, 1.0))
    for k, position_m in enumerate(seen):
        walker.update(HeadObservation(float(times_s[k]), position_m))
        if 30 <= k < 75:
            x, y, _ = walker.forecast(float(times_s[k + 15])).means_base_m[0]
            off_deg.append(np.degrees(np.arctan2(y, x) - np.arctan2(true_m[k + 15, 1], true_m[k + 15, 0])))
    assert np.sqrt(np.mean(np.square(off_deg))) < 1.0
