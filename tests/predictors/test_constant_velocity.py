"""Constant velocity, against direct Gaussian solves; what is refused, and when a track begins anew."""

import numpy as np
import pytest
from builders.people import FRAME_S, WALK_M_S, seen, walk
from hypothesis import given
from hypothesis import strategies as st

from predictors import ConstantVelocity, HeadObservation


def joint_gaussian(seen_s, seen_m, times_s, psd, noise_m):
    """Forecast by one dense solve, per axis.

    Position = p0 + v0 t + integral of (t - s) dW(s). As the filter does, the first observation is the prior mean,
    with its noise as the prior's variance; the speed's prior is 0 +- 1 m/s.
    """
    t = np.concatenate([seen_s, times_s]) - seen_s[0]
    early, late = np.minimum.outer(t, t), np.maximum.outer(t, t)
    joint = noise_m**2 + np.outer(t, t) + psd * (early**2 * late / 2 - early**3 / 6)
    n = seen_s.size
    spread = joint[1:n, 1:n] + noise_m**2 * np.eye(n - 1)
    gain = np.linalg.solve(spread, joint[1:n, n:]).T
    means = seen_m[0] + gain @ (seen_m[1:] - seen_m[0])
    return means, np.diag(joint[n:, n:] - gain @ joint[1:n, n:])


@given(
    steps_s=st.lists(st.sampled_from([0.004, 0.02, FRAME_S, 0.05, 0.4, 2.0]), min_size=1, max_size=25),
    psd=st.sampled_from([0.01, 0.05, 1.0]),
    noise_m=st.sampled_from([0.003, 0.01, 0.05]),
    seed=st.integers(0, 1000),
)
def test_filter_is_the_exact_gaussian_posterior_for_irregular_stamps(steps_s, psd, noise_m, seed):
    rng = np.random.default_rng(seed)
    seen_s = 5.0 + np.concatenate([[0.0], np.cumsum(steps_s)])
    seen_m = np.array([3.0, -1.0, 0.5]) + (seen_s[:, None] - 5.0) * WALK_M_S
    seen_m = seen_m + 0.5 * noise_m * rng.standard_normal(seen_m.shape)
    cv = ConstantVelocity(acceleration_psd=psd, position_noise_m=noise_m)
    for time_s, position_m in zip(seen_s, seen_m, strict=True):
        cv.update(HeadObservation(time_s, position_m))
        assert cv.rejections_in_a_row == 0
    times_s = seen_s[-1] + np.array([0.0, 0.01, 0.25, 0.5, 1.0])
    forecast = cv.forecast(times_s)
    means, variances = joint_gaussian(seen_s, seen_m, times_s, psd, noise_m)
    np.testing.assert_allclose(forecast.means_base_m, means, rtol=0, atol=1e-9)
    np.testing.assert_allclose(forecast.covariances_m2, variances[:, None, None] * np.eye(3), rtol=1e-9, atol=1e-9)
    assert forecast.issued_at_s == seen_s[-1]


def show_jumps(cv, count):
    """Show another place, 0.5 m aside, for a number of frames; gives the last time and place."""
    end_s = walk(cv)
    jump = cv.forecast(end_s).means_base_m[0] + [0.0, 0.5, 0.0]
    for i in range(1, count + 1):
        cv.update(seen(end_s + i * FRAME_S, jump + 0.001 * i))
    return end_s + count * FRAME_S, jump + 0.001 * count


def test_after_0_75_s_of_refusals_the_track_is_that_of_what_was_refused():
    """With all of its history: as a filter that saw nothing else."""
    cv, fresh = ConstantVelocity(), ConstantVelocity()
    end_s, place_m = show_jumps(cv, 24)
    for i in range(1, 25):
        fresh.update(seen(end_s - (24 - i) * FRAME_S, place_m - 0.001 * (24 - i)))
    for mine, expected in zip(cv.state(), fresh.state(), strict=True):
        np.testing.assert_allclose(mine, expected, rtol=0, atol=1e-12)
    assert cv.forecast(end_s).issued_at_s == end_s
    assert cv.started_at_s == pytest.approx(end_s - 23 * FRAME_S)
    assert len(cv.taken_in) == 24
    assert cv.rejections_in_a_row == 0


def test_a_person_in_a_sharp_turn_passes_the_gate():
    """1.5 m/s straight, then a quarter turn of 0.5 m radius: no observation is refused."""
    speed, radius, turn_s = 1.5, 0.5, 1.0
    predictor, rng = ConstantVelocity(), np.random.default_rng(0)
    for k in range(60):
        t = k / 30
        angle = min(max((t - turn_s) * speed / radius, 0.0), np.pi / 2)
        after = max(t - turn_s - np.pi / 2 * radius / speed, 0.0) * speed
        position = [min(t, turn_s) * speed + radius * np.sin(angle), radius * (1 - np.cos(angle)) + after, 1.6]
        predictor.update(HeadObservation(t, np.array(position) + 0.01 * rng.standard_normal(3)))
        assert predictor.rejections_in_a_row == 0, t


def test_not_gated_is_the_plain_filter_that_takes_in_everything():
    """One outlier: the exact posterior of all observations, or, gated, of all others."""
    times_s = np.arange(40) * FRAME_S
    positions_m = np.array([2.0, 1.0, 0.4]) + times_s[:, None] * WALK_M_S
    positions_m[30] += [0.0, 3.0, 0.0]
    for gated in (False, True):
        cv = ConstantVelocity(gated=gated)
        for t, position in zip(times_s, positions_m, strict=True):
            cv.update(HeadObservation(t, position))
        used = np.ones(40, dtype=bool)
        used[30] = not gated
        ahead_s = times_s[-1] + np.array([0.0, 0.5])
        mean, covariance = joint_gaussian(times_s[used], positions_m[used], ahead_s, 0.05, 0.01)
        forecast = cv.forecast(ahead_s)
        np.testing.assert_allclose(forecast.means_base_m, mean, atol=1e-6)
        expected = covariance[:, None, None] * np.eye(3)
        np.testing.assert_allclose(forecast.covariances_m2, expected, atol=1e-6)
