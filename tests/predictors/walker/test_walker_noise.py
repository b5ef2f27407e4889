"""Estimates of `Walker`: white noise and range errors."""

import numpy as np
import pytest
from builders.trackers import seen_m, wander
from builders.walkers import random_covariance, straight_model

from predictors import HeadObservation, Walker
from predictors.walker.features import WalkerHistory
from predictors.walker.range_error import MeasuredRange

FRAME_S = 1.0 / 30.0


def walk_m(times_s):
    """A walk with sway and bob."""
    bob, sway = 0.02 * np.sin(2 * np.pi * 1.9 * times_s), 0.02 * np.sin(2 * np.pi * 0.95 * times_s)
    return np.stack([1.2 * times_s, sway, 0.4 + bob], axis=1)


LINE, SURELY_M2 = np.array([0.0, 0.0, 0.4, 1.2, 0.0, 0.0]), 1e-4 * np.eye(3)


def measured(times_s, positions_m):
    """Estimate after each frame."""
    history, found = WalkerHistory(), []
    for time_s, position_m in zip(times_s, positions_m, strict=True):
        history.add(HeadObservation(time_s, position_m), LINE, SURELY_M2)
        found.append(history.white_noise_m2())
    return np.array(found)


@pytest.mark.parametrize("rate_hz", [15.0, 60.0])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_size_and_direction_of_white_noise_are_estimated(rate_hz, jitter):
    """Regular or irregular frames; gait is not estimated as noise."""
    rng = np.random.default_rng(3)
    times_s = (np.arange(600) + jitter * rng.uniform(-0.5, 0.5, 600)) / rate_hz
    true = random_covariance(rng, (0.03, 0.01, 0.005))
    found = measured(times_s, walk_m(times_s) + rng.multivariate_normal(np.zeros(3), true, 600))[300:].mean(axis=0)
    sds, axes = np.linalg.eigh(found)
    true_sds, true_axes = np.linalg.eigh(true)
    assert abs(axes[:, 2] @ true_axes[:, 2]) > np.cos(np.radians(6.0))
    np.testing.assert_allclose(np.sqrt(sds), np.sqrt(true_sds), rtol=0.15, atol=0.0015)


def test_without_noise_the_estimate_is_the_floor_and_robust_to_a_spike():
    times_s = np.arange(300) * FRAME_S
    np.testing.assert_allclose(
        np.sqrt(measured(times_s, walk_m(times_s))[150:].mean(axis=0).diagonal()), 0.002, atol=0.001
    )
    shaken = walk_m(times_s)
    shaken[200] += [5.0, 0.0, 0.0]
    assert np.sqrt(measured(times_s, shaken)[150:, 0, 0].mean()) < 0.05


@pytest.mark.parametrize(("rate_hz", "share"), [(30.0, 7.0 / 9.0), (10.0, 0.0)])
def test_the_prior_loses_weight_with_each_measurement(rate_hz, share):
    """Third differences of a constant size, 8 / sqrt(20) of an alternation: the prior's weight is 2 / (frames - 1)."""
    positions_m = np.outer((-1.0) ** np.arange(10), [0.003, 0.0, 0.0])
    found_m2 = measured(np.arange(10) / rate_hz, positions_m)[-1]
    prior_m2, measured_m2 = (1.0 - share) * 0.01**2, share * 64.0 / 20.0 * 0.003**2
    expected_m2 = [prior_m2 + 0.002**2 + own for own in (measured_m2, 0.0, 0.0)]
    np.testing.assert_allclose(found_m2.diagonal(), expected_m2)


# ---------------------------------------------------------------- errors of the range


STEP_S = 1.0 / 30.0


def passing_m(times_s):
    """Past the robot at 2.5 m, with sway and bob."""
    sway, bob = 0.02 * np.sin(2 * np.pi * 0.95 * times_s), 0.02 * np.sin(2 * np.pi * 1.9 * times_s)
    return np.stack([2.5 + sway, 1.2 * (times_s - times_s[-1] / 2), 0.4 + bob], axis=1)


def range_measured(times_s, positions_m):
    """Range variance after each frame."""
    found = MeasuredRange()
    variances_m2 = []
    for time_s, position_m in zip(times_s.tolist(), positions_m, strict=True):
        found.learn(HeadObservation(time_s, position_m))
        variances_m2.append(found.variance_m2)
    return found, np.array(variances_m2)


@pytest.mark.parametrize("rate_hz", [10.0, 60.0])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_white_range_error_is_estimated(rate_hz, jitter):
    rng, n = np.random.default_rng(0), 400
    times_s = (np.arange(n) + jitter * rng.uniform(-0.5, 0.5, n)) / rate_hz
    standing_m = np.tile([2.0, 1.5, 0.0], (n, 1))
    _, variances_m2 = range_measured(times_s, seen_m(rng, standing_m, times_s, along=(0.15, 0.0, 1.0)))
    # The drift has weight four, and occurs by chance without range errors.
    assert 0.9 * 0.375 < np.sqrt(np.median(variances_m2[50:])) < 1.6 * 0.375


@pytest.mark.parametrize("noise_m", [0.0, 0.01])
def test_ordinary_trackers_have_no_range_error(noise_m):
    """Neither gait nor isotropic white noise is estimated as range error."""
    rng, times_s = np.random.default_rng(1), np.arange(300) * STEP_S
    _, variances_m2 = range_measured(times_s, passing_m(times_s) + noise_m * rng.standard_normal((300, 3)))
    assert np.sqrt(variances_m2.max()) < 0.03


def test_range_drift_is_estimated_above_its_frame_differences():
    """Frame differences are 0.03 m; in 0.2 s the drift is twice as large."""
    rng, times_s = np.random.default_rng(3), np.arange(300) * STEP_S
    drift = wander(rng, times_s, 0.1, 4.0)
    _, variances_m2 = range_measured(times_s, passing_m(times_s) * (1.0 + drift))
    assert np.sqrt(np.median(variances_m2[60:])) > 0.04


def test_the_covariance_lies_along_the_line_of_sight():
    rng, times_s = np.random.default_rng(4), np.arange(60) * STEP_S
    found, variances_m2 = range_measured(times_s, seen_m(rng, passing_m(times_s), times_s, along=(0.15, 0.0, 1.0)))
    sight = np.array([2.0, -1.0, 2.0]) / 3.0
    covariance_m2 = found.covariance_m2(2.7 * sight)
    np.testing.assert_allclose(covariance_m2, variances_m2[-1] * np.outer(sight, sight), rtol=1e-12)
    assert not found.covariance_m2(np.zeros(3)).any()


@pytest.mark.parametrize("every_s", [2 * STEP_S, 1.8])
def test_intermittent_other_people_give_no_range_error(every_s):
    """Also with alternating people; the other one is 1 m to the left."""
    rng, times_s = np.random.default_rng(8), np.arange(300) * STEP_S
    seen_m = passing_m(times_s) + 0.01 * rng.standard_normal((300, 3))
    left = np.stack([-seen_m[:, 1], seen_m[:, 0], np.zeros(300)], axis=1)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    _, variances_m2 = range_measured(times_s, seen_m + left * (times_s % every_s > 0.6 * every_s)[:, None])
    assert np.sqrt(variances_m2.max()) < 0.05


def test_range_noise_does_not_bias_the_forecast_direction():
    """With an isotropic error model this would be 1.4 to 3.4 deg."""
    rng, times_s = np.random.default_rng(6), np.arange(90) * STEP_S
    true_m = passing_m(times_s)
    walker, off_deg = Walker(straight_model()), []
    seen = seen_m(rng, true_m, times_s, along=(0.15, 0.0, 1.0), across_deg=(0.1, 0.0, 1.0))
    for k, position_m in enumerate(seen):
        walker.update(HeadObservation(float(times_s[k]), position_m))
        if 30 <= k < 75:
            x, y, _ = walker.forecast(float(times_s[k + 15])).means_base_m[0]
            off_deg.append(np.degrees(np.arctan2(y, x) - np.arctan2(true_m[k + 15, 1], true_m[k + 15, 0])))
    assert np.sqrt(np.mean(np.square(off_deg))) < 1.0
