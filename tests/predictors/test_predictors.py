"""Predictors against direct Gaussian solves, the paper's equations by hand, and properties all of them share."""

import ast
import subprocess
import sys
from collections.abc import Callable
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import predictors
from predictors import (
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    HeadObservation,
    HeadPose,
    InteractingModels,
    LastPosition,
    NotReadyError,
    OutOfOrderError,
    ParticleFilter,
    PelvisPursuit,
    Perfect,
    Predictor,
    Walker,
)
from predictors.yaw import wrap_rad, yaw_rad

Array = NDArray[np.float64]
FRAME_S = 1.0 / 30.0
WALK_M_S = np.array([1.1, -0.4, 0.05])
MAKERS: dict[str, Callable[[], Predictor]] = {
    "last": LastPosition,
    "cv": ConstantVelocity,
    "ca": ConstantAcceleration,
    "ctrv": CoordinatedTurn,
    "ctrv with yaw": lambda: CoordinatedTurn(yaw_cues="both"),
    "imm": InteractingModels,
    "particle": ParticleFilter,
    "head": lambda: HeadPose(weight=0.7),
    "pursuit": PelvisPursuit,
    "walker": Walker,
    "perfect": lambda: Perfect(lambda times: np.outer(times, WALK_M_S)),
}
every_predictor = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS.keys())


def yaw_quat(yaw: float) -> Array:
    return np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])


def seen(time_s: float, position_m: Array, head_yaw: float | None = None, waist_yaw: float = 0.0) -> HeadObservation:
    if head_yaw is None:
        return HeadObservation(time_s, position_m)
    return HeadObservation(time_s, position_m, yaw_quat(head_yaw), yaw_quat(waist_yaw))


def walk(predictor: Predictor, frames: int = 30, relative_yaw: float | None = None, noise_m: float = 0.005) -> float:
    """Show a predictor a straight walk; gives the time of the last frame."""
    rng = np.random.default_rng(3)
    for i in range(frames):
        position = np.array([2.0, 1.0, 0.4]) + i * FRAME_S * WALK_M_S + noise_m * rng.standard_normal(3)
        head = None if relative_yaw is None else relative_yaw + 0.3
        predictor.update(seen(i * FRAME_S, position, head, waist_yaw=0.3))
    return (frames - 1) * FRAME_S


def joint_gaussian(seen_s: Array, seen_m: Array, times_s: Array, psd: float, noise_m: float) -> tuple[Array, Array]:
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


# ---------------------------------------------------------------- constant velocity


@given(
    steps_s=st.lists(st.sampled_from([0.004, 0.02, FRAME_S, 0.05, 0.4, 2.0]), min_size=1, max_size=25),
    psd=st.sampled_from([0.01, 0.05, 1.0]),
    noise_m=st.sampled_from([0.003, 0.01, 0.05]),
    seed=st.integers(0, 1000),
)
def test_filter_is_the_exact_gaussian_posterior_for_irregular_stamps(
    steps_s: list[float], psd: float, noise_m: float, seed: int
) -> None:
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


def test_start_is_the_first_observation_at_rest() -> None:
    cv = ConstantVelocity(acceleration_psd=0.05, position_noise_m=0.02)
    cv.update(seen(2.0, np.array([1.0, 2.0, 3.0])))
    forecast = cv.forecast([2.0, 3.0])
    np.testing.assert_array_equal(forecast.means_base_m, np.tile([1.0, 2.0, 3.0], (2, 1)))
    np.testing.assert_allclose(forecast.covariances_m2[0], 0.02**2 * np.eye(3), atol=1e-15)
    np.testing.assert_allclose(forecast.covariances_m2[1], (0.02**2 + 1.0 + 0.05 / 3) * np.eye(3), atol=1e-15)


def test_noise_free_walk_is_forecast_exactly_in_the_limit() -> None:
    errors = []
    for noise_m in (5e-2, 1e-2, 1e-4):
        cv = ConstantVelocity(position_noise_m=noise_m)
        end_s = walk(cv, frames=30, noise_m=0.0)
        truth = np.array([2.0, 1.0, 0.4]) + (end_s + 1.0) * WALK_M_S
        errors.append(np.linalg.norm(cv.forecast(end_s + 1.0).means_base_m[0] - truth))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-9


def test_gap_coasts_and_grows_the_covariance() -> None:
    cv = ConstantVelocity()
    end_s = walk(cv)
    _, x, _ = cv.state()
    forecast = cv.forecast(end_s + np.linspace(0.0, 3.0, 7))
    np.testing.assert_allclose(forecast.means_base_m, x[:3] + np.linspace(0.0, 3.0, 7)[:, None] * x[3:], atol=1e-12)
    assert np.all(np.diff(forecast.covariances_m2[:, 0, 0]) > 0)


def test_single_jump_leaves_no_trace_but_the_time() -> None:
    """A refused observation: afterwards the filter is as one that never saw it."""
    cv, spared = ConstantVelocity(), ConstantVelocity()
    end_s = walk(cv)
    walk(spared)
    jump = cv.forecast(end_s + FRAME_S).means_base_m[0] + [0.0, 0.5, 0.0]
    cv.update(seen(end_s + FRAME_S, jump))
    assert cv.rejections_in_a_row == 1
    ahead_s = end_s + np.array([0.1, 0.5, 1.0])
    before, after = spared.forecast(ahead_s), cv.forecast(ahead_s)
    np.testing.assert_allclose(after.means_base_m, before.means_base_m, atol=1e-12)
    np.testing.assert_allclose(after.covariances_m2, before.covariances_m2, atol=1e-12)
    assert after.issued_at_s == end_s
    assert cv.state()[0] == end_s + FRAME_S
    good = cv.forecast(end_s + 2 * FRAME_S).means_base_m[0]
    for predictor in (cv, spared):
        predictor.update(seen(end_s + 2 * FRAME_S, good + 0.002))
    np.testing.assert_allclose(cv.state()[1], spared.state()[1], atol=1e-12)
    np.testing.assert_allclose(cv.state()[2], spared.state()[2], atol=1e-12)
    assert cv.rejections_in_a_row == 0


def show_jumps(cv: ConstantVelocity, count: int) -> tuple[float, Array]:
    """Show another place, 0.5 m aside, for a number of frames; gives the last time and place."""
    end_s = walk(cv)
    jump = cv.forecast(end_s).means_base_m[0] + [0.0, 0.5, 0.0]
    for i in range(1, count + 1):
        cv.update(seen(end_s + i * FRAME_S, jump + 0.001 * i))
    return end_s + count * FRAME_S, jump + 0.001 * count


@pytest.mark.parametrize("count", [5, 9])
def test_burst_of_false_detections_does_not_move_the_track(count: int) -> None:
    cv, spared = ConstantVelocity(), ConstantVelocity()
    end_s, _ = show_jumps(cv, count)
    walk(spared)
    assert cv.rejections_in_a_row == count
    np.testing.assert_allclose(cv.forecast(end_s).means_base_m, spared.forecast(end_s).means_base_m, atol=1e-12)


def test_ten_refusals_in_a_row_restart_the_track() -> None:
    cv, fresh = ConstantVelocity(), ConstantVelocity()
    end_s, place_m = show_jumps(cv, 10)
    fresh.update(seen(end_s, place_m))
    for mine, expected in zip(cv.state(), fresh.state(), strict=True):
        np.testing.assert_array_equal(mine, expected)
    assert cv.forecast(end_s).issued_at_s == end_s
    assert cv.rejections_in_a_row == 0


def test_an_accepted_observation_ends_the_count_of_refusals() -> None:
    cv = ConstantVelocity()
    end_s, _ = show_jumps(cv, 9)
    cv.update(seen(end_s + FRAME_S, cv.forecast(end_s + FRAME_S).means_base_m[0]))
    jump = cv.forecast(end_s + 2 * FRAME_S).means_base_m[0] + [0.0, 0.5, 0.0]
    cv.update(seen(end_s + 2 * FRAME_S, jump))
    assert cv.rejections_in_a_row == 1


@pytest.mark.parametrize("bad", [{"acceleration_psd": 0.0}, {"position_noise_m": -1.0}, {"position_noise_m": np.nan}])
def test_constant_velocity_refuses_impossible_noise(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        ConstantVelocity(**bad)


def test_state_is_a_copy() -> None:
    cv = ConstantVelocity()
    walk(cv)
    _, x, P = cv.state()
    x += 1.0
    P += 1.0
    assert not np.any(np.isclose(cv.state()[1], x))
    assert not np.any(np.isclose(cv.state()[2], P))


# ---------------------------------------------------------------- head pose


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("relative_yaw", [0.0, 0.4, -1.2])
def test_head_pose_is_the_papers_equations_1_to_5(weight: float, relative_yaw: float) -> None:
    """N = 15 steps of 1/30 s, with x(t|t) from the Kalman filter that sees the same positions."""
    head, kalman = HeadPose(weight=weight), ConstantVelocity()
    end_s = walk(head, relative_yaw=relative_yaw)
    walk(kalman)
    _, x, _ = kalman.state()
    x_next = np.array([x[i] + FRAME_S * x[i + 3] for i in range(3)])  # equation 1
    d_kalman = x_next - x[:3]  # equation 2
    c, s = np.cos(relative_yaw), np.sin(relative_yaw)
    d_head = np.array([c * d_kalman[0] - s * d_kalman[1], s * d_kalman[0] + c * d_kalman[1], d_kalman[2]])
    d_p = (1 - weight) * d_kalman + weight * d_head  # equation 4
    forecast = head.forecast([end_s + FRAME_S, end_s + 15 * FRAME_S])
    np.testing.assert_allclose(forecast.means_base_m[0], x[:3] + d_p, atol=1e-12)
    np.testing.assert_allclose(forecast.means_base_m[1], x[:3] + 15 * d_p, atol=1e-12)  # equation 5
    np.testing.assert_allclose(forecast.means_base_m[:, 2], kalman.forecast(forecast.times_s).means_base_m[:, 2])


def test_head_turned_left_bends_the_path_left() -> None:
    bent, straight = HeadPose(weight=1.0), ConstantVelocity()
    end_s = walk(bent, relative_yaw=np.pi / 2)
    walk(straight)
    now, ahead = straight.forecast([end_s, end_s + 0.5]).means_base_m
    step = bent.forecast(end_s + 0.5).means_base_m[0] - now
    np.testing.assert_allclose(step, [-(ahead - now)[1], (ahead - now)[0], (ahead - now)[2]], atol=1e-12)


def test_weight_0_is_constant_velocity_exactly() -> None:
    head, kalman = HeadPose(weight=0.0), ConstantVelocity()
    end_s = walk(head, relative_yaw=0.8)
    walk(kalman)
    times_s = end_s + np.linspace(0.0, 1.0, 11)
    mine, expected = head.forecast(times_s), kalman.forecast(times_s)
    np.testing.assert_array_equal(mine.means_base_m, expected.means_base_m)
    np.testing.assert_array_equal(mine.covariances_m2, expected.covariances_m2)


def test_head_pose_covariance_is_that_of_the_turned_state() -> None:
    weight, yaw, psd, tau = 0.6, 0.9, 0.05, 0.5
    head, kalman = HeadPose(weight=weight), ConstantVelocity()
    end_s = walk(head, frames=4, relative_yaw=yaw)  # few frames: position and velocity are still correlated
    walk(kalman, frames=4)
    _, x, P = kalman.state()
    turn = Rotation.from_euler("z", yaw).as_matrix()
    M = np.hstack([np.eye(3), tau * ((1 - weight) * np.eye(3) + weight * turn)])
    expected = M @ P @ M.T + psd * tau**3 / 3 * np.eye(3)
    forecast = head.forecast(end_s + tau)
    np.testing.assert_allclose(forecast.covariances_m2[0], expected, atol=1e-12)
    np.testing.assert_allclose(forecast.means_base_m[0], M @ x, atol=1e-12)
    assert np.linalg.norm(P[:3, 3:]) > 1e-6


def test_without_orientation_head_pose_is_constant_velocity() -> None:
    head, kalman = HeadPose(weight=1.0), ConstantVelocity()
    end_s = walk(head)
    walk(kalman)
    assert head.relative_yaw_rad() is None
    np.testing.assert_array_equal(head.forecast(end_s + 0.5).means_base_m, kalman.forecast(end_s + 0.5).means_base_m)


def test_the_last_yaw_is_good_for_half_a_second_only() -> None:
    head, kalman = HeadPose(weight=1.0), ConstantVelocity()
    end_s = walk(head, relative_yaw=0.7)
    walk(kalman)
    for i in range(1, 31):
        observation = seen(end_s + i * FRAME_S, kalman.forecast(end_s + i * FRAME_S).means_base_m[0])
        kalman.update(observation)
        head.update(observation)
        if i * FRAME_S < 0.499:
            assert head.relative_yaw_rad() == pytest.approx(0.7)
        elif i * FRAME_S > 0.501:
            assert head.relative_yaw_rad() is None
    later_s = end_s + 31 * FRAME_S
    np.testing.assert_array_equal(
        head.forecast(later_s + 0.5).means_base_m, kalman.forecast(later_s + 0.5).means_base_m
    )
    head.update(seen(later_s, kalman.forecast(later_s).means_base_m[0], head_yaw=-0.2))
    assert head.relative_yaw_rad() == pytest.approx(-0.2)  # the old yaw is not in it


@pytest.mark.parametrize("missing", ["head", "pelvis"])
def test_one_orientation_of_two_is_none(missing: str) -> None:
    head = HeadPose()
    quat = yaw_quat(0.4)
    position = np.ones(3)
    if missing == "head":
        head.update(HeadObservation(0.0, position, None, quat))
    else:
        head.update(HeadObservation(0.0, position, quat, None))
    assert head.relative_yaw_rad() is None


def test_relative_yaw_is_filtered_across_pi() -> None:
    """Measured at 180 deg +- 3 deg to either side; an average of the bare numbers would be near 0."""
    head = HeadPose()
    for i in range(40):
        head.update(seen(i * FRAME_S, np.ones(3), head_yaw=np.pi + 0.05 * (-1) ** i))
    estimate = head.relative_yaw_rad()
    assert estimate is not None
    assert abs(wrap_rad(estimate - np.pi)) < 0.05


def test_relative_yaw_is_the_scalar_kalman_filter_of_a_random_walk() -> None:
    """Head and waist both past pi, so that only the wrapped difference is small; psd 1 rad^2/s."""
    rng = np.random.default_rng(5)
    measured = 0.3 + 0.05 * rng.standard_normal(20)
    head = HeadPose(yaw_noise_rad=0.05)
    estimate, variance = measured[0], 0.05**2
    for i, angle in enumerate(measured):
        head.update(seen(i * FRAME_S, np.ones(3), head_yaw=3.0 + angle, waist_yaw=3.0))
        if i:
            variance += FRAME_S
            gain = variance / (variance + 0.05**2)
            estimate, variance = estimate + gain * (angle - estimate), (1 - gain) * variance
        assert head.relative_yaw_rad() == pytest.approx(estimate, abs=1e-12)


@pytest.mark.parametrize("weight", [-0.01, 1.01, 7.51, float("nan")])
def test_weight_outside_0_to_1_is_refused(weight: float) -> None:
    with pytest.raises(ValueError, match=r"weight must be in \[0, 1\]"):
        HeadPose(weight=weight)


# ---------------------------------------------------------------- last position, perfect


def test_last_position_stays_and_spreads_at_walking_speed() -> None:
    last = LastPosition(position_noise_m=0.02, walking_speed_m_s=0.5)
    last.update(seen(1.0, np.array([9.0, 9.0, 9.0])))
    last.update(seen(2.0, np.array([1.0, 2.0, 3.0])))
    forecast = last.forecast([2.0, 2.4])
    np.testing.assert_array_equal(forecast.means_base_m, np.tile([1.0, 2.0, 3.0], (2, 1)))
    np.testing.assert_allclose(forecast.covariances_m2[0], 0.0004 * np.eye(3))
    np.testing.assert_allclose(forecast.covariances_m2[1], 0.0404 * np.eye(3))
    assert forecast.issued_at_s == 2.0


def test_perfect_gives_the_true_future_surely() -> None:
    perfect = Perfect(lambda times: np.stack([np.sin(times), times**2, np.ones_like(times)], axis=-1))
    perfect.update(seen(0.5, np.zeros(3)))
    forecast = perfect.forecast([0.5, 2.0])
    np.testing.assert_array_equal(forecast.means_base_m, [[np.sin(0.5), 0.25, 1.0], [np.sin(2.0), 4.0, 1.0]])
    assert not np.any(forecast.covariances_m2)
    assert forecast.issued_at_s == 0.5


# ---------------------------------------------------------------- what all of them share


@every_predictor
def test_forecast_changes_nothing_and_is_the_same_in_any_order(make: Callable[[], Predictor]) -> None:
    predictor = make()
    end_s = walk(predictor, relative_yaw=0.5)
    times_s = end_s + np.array([0.5, 0.0, 1.0, 0.25])
    first = predictor.forecast(times_s)
    shuffle = np.array([2, 0, 3, 1])
    again = predictor.forecast(times_s[shuffle])
    np.testing.assert_array_equal(again.times_s, times_s[shuffle])
    np.testing.assert_array_equal(again.means_base_m, first.means_base_m[shuffle])
    np.testing.assert_array_equal(again.covariances_m2, first.covariances_m2[shuffle])
    asked, unasked = make(), make()
    for i in range(10):
        for each in (asked, unasked):
            each.update(seen(i * FRAME_S, i * FRAME_S * WALK_M_S, head_yaw=0.1 * i))
        asked.forecast(i * FRAME_S + np.linspace(0.0, 2.0, 5))
    np.testing.assert_array_equal(asked.forecast(1.0).means_base_m, unasked.forecast(1.0).means_base_m)
    np.testing.assert_array_equal(asked.forecast(1.0).covariances_m2, unasked.forecast(1.0).covariances_m2)


@every_predictor
def test_shapes(make: Callable[[], Predictor]) -> None:
    predictor = make()
    walk(predictor)
    for times_s, size in ((1.0, 1), ([1.0, 2.0, 3.0], 3), ([], 0)):
        forecast = predictor.forecast(times_s)
        assert forecast.times_s.shape == (size,)
        assert forecast.means_base_m.shape == (size, 3)
        assert forecast.covariances_m2.shape == (size, 3, 3)


@every_predictor
@pytest.mark.parametrize("bad", [[[1.0, 2.0]], [np.nan], [np.inf]])
def test_bad_times_are_refused(make: Callable[[], Predictor], bad: list[float]) -> None:
    predictor = make()
    walk(predictor)
    with pytest.raises(ValueError, match="times_s must be finite"):
        predictor.forecast(bad)


@every_predictor
def test_no_forecast_before_the_first_observation_nor_after_reset(make: Callable[[], Predictor]) -> None:
    predictor = make()
    with pytest.raises(NotReadyError):
        predictor.forecast(0.0)
    walk(predictor, relative_yaw=0.5)
    predictor.reset()
    with pytest.raises(NotReadyError):
        predictor.forecast(0.0)
    fresh = make()
    for each in (predictor, fresh):  # and an earlier clock is as good as any after a reset
        each.update(seen(-5.0, np.ones(3)))
    np.testing.assert_array_equal(predictor.forecast(-4.5).means_base_m, fresh.forecast(-4.5).means_base_m)
    assert predictor.forecast(-4.5).issued_at_s == -5.0


@every_predictor
@pytest.mark.parametrize("step_s", [0.0, -0.1])
def test_old_observations_are_refused_and_change_nothing(make: Callable[[], Predictor], step_s: float) -> None:
    predictor = make()
    end_s = walk(predictor, relative_yaw=0.5)
    before = predictor.forecast(end_s + 0.5)
    with pytest.raises(OutOfOrderError, match="not newer"):
        predictor.update(seen(end_s + step_s, np.array([50.0, 0.0, 0.0]), head_yaw=2.0))
    after = predictor.forecast(end_s + 0.5)
    np.testing.assert_array_equal(after.means_base_m, before.means_base_m)
    np.testing.assert_array_equal(after.covariances_m2, before.covariances_m2)


@every_predictor
@given(
    steps_s=st.lists(st.floats(1e-3, 2.0), min_size=1, max_size=15),
    places=arrays(np.float64, (15, 3), elements=st.floats(-5, 5)),
    yaws=arrays(np.float64, 15, elements=st.floats(-7, 7)),
    ahead_s=st.lists(st.floats(-0.5, 3.0), min_size=1, max_size=5),
)
def test_covariances_are_symmetric_and_positive_semidefinite(
    make: Callable[[], Predictor], steps_s: list[float], places: Array, yaws: Array, ahead_s: list[float]
) -> None:
    """Whatever is seen, jumps included."""
    predictor = make()
    times_s = np.cumsum(steps_s)
    for i, time_s in enumerate(times_s):
        predictor.update(seen(time_s, places[i], head_yaw=yaws[i] if i % 3 else None))
    forecast = predictor.forecast(times_s[-1] + np.array(ahead_s))
    P = forecast.covariances_m2
    scale = max(1.0, float(np.abs(P).max()))
    assert np.all(np.isfinite(forecast.means_base_m))
    np.testing.assert_allclose(P, np.swapaxes(P, 1, 2), atol=1e-12 * scale)
    assert np.linalg.eigvalsh(P).min() >= -1e-12 * scale


# ---------------------------------------------------------------- observations and orientation

GOOD = np.array([1.0, 2.0, 3.0])
QUAT = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.nan, GOOD), "capture_time_s is not finite"),
        ((np.inf, GOOD), "capture_time_s is not finite"),
        ((0.0, GOOD * np.nan), "head_position_base_m is not finite"),
        ((0.0, np.array([1.0, np.inf, 0.0])), "head_position_base_m is not finite"),
        ((0.0, np.ones(2)), r"head_position_base_m has shape \(2,\), expected \(3,\)"),
        ((0.0, np.ones((1, 3))), "head_position_base_m has shape"),
        ((0.0, GOOD, np.ones(3)), "head_quat_wxyz has shape"),
        ((0.0, GOOD, QUAT * np.nan), "head_quat_wxyz is not finite"),
        ((0.0, GOOD, QUAT, 1.01 * QUAT), "pelvis_quat_wxyz is not of unit length"),
        ((0.0, GOOD, np.zeros(4)), "head_quat_wxyz is not of unit length"),
    ],
)
def test_observation_refuses(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        HeadObservation(*arguments)  # type: ignore[arg-type]


def test_observation_takes_plain_lists_and_is_frozen() -> None:
    observation = HeadObservation(0.0, [1, 2, 3], [1, 0, 0, 0])  # type: ignore[arg-type]
    assert observation.head_position_base_m.dtype == np.float64
    assert observation.head_quat_wxyz is not None
    assert observation.pelvis_quat_wxyz is None
    with pytest.raises(FrozenInstanceError):
        observation.capture_time_s = 1.0  # type: ignore[misc]


@given(yaw=st.floats(-np.pi, np.pi), pitch=st.floats(-1.5, 1.5), roll=st.floats(-np.pi, np.pi))
def test_yaw_is_the_heading_of_the_forward_axis(yaw: float, pitch: float, roll: float) -> None:
    rotation = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    x, y, _ = rotation.apply([1.0, 0.0, 0.0])
    quat = rotation.as_quat(scalar_first=True)
    assert abs(wrap_rad(yaw_rad(quat) - np.arctan2(y, x))) < 1e-9
    assert abs(wrap_rad(yaw_rad(-quat) - yaw)) < 1e-9


@given(angle=st.floats(-50, 50))
def test_wrapped_angle_is_the_same_direction_within_half_a_turn(angle: float) -> None:
    wrapped = wrap_rad(angle)
    assert -np.pi < wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-12)


def test_wrap_keeps_plus_pi() -> None:
    assert wrap_rad(np.pi) == wrap_rad(-np.pi) == np.pi


# ---------------------------------------------------------------- independence


def test_predictors_know_nothing_of_gaze() -> None:
    """Neither in an import statement anywhere in the package, nor by what an import pulls in."""
    folder = Path(predictors.__file__).parent
    for file in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not {"gazempc", "experiments"} & {name.split(".")[0] for name in names}, file.name
    code = "import sys, predictors; print([m for m in sys.modules if m.split('.')[0] in ('gazempc', 'filterpy')])"
    done = subprocess.run([sys.executable, "-c", code], cwd=folder.parent, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_head_of_a_refused_detection_does_not_bend_the_forecast():
    """Another person, 3 m away and turned, is detected once: position and yaw both stay as they were."""
    predictor = HeadPose(weight=1.0)
    turned = np.array([np.cos(1.0), 0.0, 0.0, np.sin(1.0)])
    straight = np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(30):
        predictor.update(HeadObservation(k / 30, np.array([k / 30, 0.0, 0.4]), straight, straight))
    predictor.update(HeadObservation(1.0, np.array([1.0, 3.0, 0.4]), turned, straight))
    assert predictor.relative_yaw_rad() == pytest.approx(0.0, abs=1e-12)


def test_a_person_in_a_sharp_turn_is_not_taken_for_somebody_else():
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


# Options of HeadPose that are not in the paper


def turned_walk(
    predictor: Predictor,
    frames: int,
    angle: float = np.radians(20.0),
    speed: float = 1.2,
    start_s: float = 0.0,
    start_m: tuple[float, float, float] = (2.0, 1.0, 0.4),
    waist_yaw: float | None = None,
) -> float:
    """A noise-free straight walk at heading 0.3 rad with the head turned by a constant angle; gives the last time."""
    direction = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    for i in range(frames):
        head, waist = yaw_quat(0.3 + angle), None if waist_yaw is None else yaw_quat(waist_yaw)
        position = np.array(start_m) + i * FRAME_S * speed * direction
        predictor.update(HeadObservation(start_s + i * FRAME_S, position, head, waist))
    return start_s + (frames - 1) * FRAME_S


@pytest.mark.parametrize("waist_yaw", [None, -2.0])
def test_yaw_from_travel_is_the_heads_turn_from_the_path(waist_yaw: float | None) -> None:
    """Where the waist points, or whether it is known, does not matter."""
    head, kalman = HeadPose(weight=1.0, yaw_from="travel"), ConstantVelocity()
    end_s = turned_walk(head, 60, waist_yaw=waist_yaw)
    turned_walk(kalman, 60)
    assert head.relative_yaw_rad() == pytest.approx(np.radians(20.0), abs=1e-9)
    now, ahead = kalman.forecast([end_s, end_s + 0.5]).means_base_m
    expected = now + Rotation.from_euler("z", 20.0, degrees=True).apply(ahead - now)
    np.testing.assert_allclose(head.forecast(end_s + 0.5).means_base_m[0], expected, atol=1e-9)


@pytest.mark.parametrize(("yaw_from", "waist_yaw"), [("travel", None), ("waist", 0.3)])
def test_a_constant_offset_is_removed_as_time_goes_on(yaw_from: Literal["waist", "travel"], waist_yaw: float) -> None:
    """The mean is the angle itself and is believed by T / (T + 0.5 s): 0.5 / (T + 0.5) of the angle is left."""
    weight, speed = 0.7, 1.2
    for frames in (10, 45, 300):
        removed = HeadPose(weight, yaw_from=yaw_from, offset_removed=True)
        kept, kalman = HeadPose(weight, yaw_from=yaw_from), ConstantVelocity()
        for predictor in (removed, kept, kalman):
            end_s = turned_walk(predictor, frames, waist_yaw=waist_yaw)
        # With the first frame nobody travels yet: the yaw is known from the second one on.
        known_s = end_s - (1 / 30 if yaw_from == "travel" else 0.0)
        left = np.radians(20.0) * 0.5 / (known_s + 0.5)
        assert removed.relative_yaw_rad() == pytest.approx(left, abs=1e-9)
        assert kept.relative_yaw_rad() == pytest.approx(np.radians(20.0), abs=1e-9)
        plain = kalman.forecast(end_s + 0.5).means_base_m
        speed = float(np.linalg.norm(kalman.state()[1][3:]))
        for predictor, angle in ((removed, left), (kept, np.radians(20.0))):
            bend_m = np.linalg.norm(predictor.forecast(end_s + 0.5).means_base_m - plain)
            assert bend_m == pytest.approx(weight * 0.5 * speed * 2 * np.sin(angle / 2), abs=1e-9)


def test_a_swinging_yaw_keeps_its_swing_when_its_mean_is_removed() -> None:
    """The offset is that of the filtered yaw, frame by frame."""
    with_offset, without = (HeadPose(offset_removed=removed) for removed in (False, True))
    total = 0.0
    for i in range(90):
        angle = 0.3 + 0.2 * np.sin(i / 5)
        for predictor in (with_offset, without):
            predictor.update(seen(i * FRAME_S, np.array([2.0, 0.01 * i, 0.4]), 1.0 + angle, 1.0))
        filtered, time_s = with_offset.relative_yaw_rad(), i * FRAME_S
        total += filtered or 0.0
        expected = (filtered or 0.0) - total / (i + 1) * time_s / (time_s + 0.5)
        assert without.relative_yaw_rad() == pytest.approx(expected, abs=1e-12)


def test_slower_than_0_2_m_s_nobody_has_a_direction_of_travel() -> None:
    for speed, known in ((0.15, False), (0.25, True)):
        head, kalman = HeadPose(1.0, yaw_from="travel"), ConstantVelocity()
        end_s = turned_walk(head, 90, speed=speed)
        turned_walk(kalman, 90, speed=speed)
        assert (head.relative_yaw_rad() is not None) == known
        same = np.array_equal(head.forecast(end_s + 0.5).means_base_m, kalman.forecast(end_s + 0.5).means_base_m)
        assert same != known


def test_who_stops_keeps_the_last_yaw_for_half_a_second() -> None:
    head = HeadPose(yaw_from="travel")
    end_s = turned_walk(head, 60)
    at_m = np.array([2.0, 1.0, 0.4]) + 59 * FRAME_S * 1.2 * np.array([np.cos(0.3), np.sin(0.3), 0.0])
    known = []
    for i in range(1, 60):
        head.update(HeadObservation(end_s + i * FRAME_S, at_m, yaw_quat(2.5)))
        known.append(head.relative_yaw_rad() is not None)
    assert known[:15] == [True] * 15
    assert known[-15:] == [False] * 15


def test_a_new_track_forgets_the_offset_of_the_old_one() -> None:
    """Ten refusals, then a track 5 m away whose head is turned the other way: its own mean alone is removed."""
    head = HeadPose(yaw_from="travel", offset_removed=True)
    end_s = turned_walk(head, 90)
    start_s = end_s + FRAME_S
    last_s = turned_walk(head, 100, np.radians(-10.0), start_s=start_s, start_m=(2.0, 6.0, 0.4))
    began_s = start_s + 9 * FRAME_S  # the tenth refused observation begins the new track
    expected = np.radians(-10.0) * 0.5 / (last_s - began_s + 0.5)
    assert head.relative_yaw_rad() == pytest.approx(expected, abs=np.radians(0.1))
    head.reset()
    turned_walk(head, 30)
    fresh = HeadPose(yaw_from="travel", offset_removed=True)
    turned_walk(fresh, 30)
    assert head.relative_yaw_rad() == fresh.relative_yaw_rad()


def test_the_mean_yaw_does_not_depend_on_the_turn_by_which_the_angle_is_counted() -> None:
    """A head that faces backwards, 170 then 190 deg from the waist, with 0.6 s unseen between: the mean is 180 deg."""
    head = HeadPose(offset_removed=True)
    for i in range(30):
        head.update(seen(i * FRAME_S, np.ones(3), head_yaw=np.radians(170.0)))
    for i in range(48, 78):
        head.update(seen(i * FRAME_S, np.ones(3), head_yaw=np.radians(190.0)))
    known_s = 77 * FRAME_S
    expected = wrap_rad(np.radians(190.0) - np.pi * known_s / (known_s + 0.5))
    assert head.relative_yaw_rad() == pytest.approx(expected, abs=1e-6)


def test_not_gated_is_the_plain_filter_that_takes_in_everything() -> None:
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


def test_not_gated_never_refuses_nor_starts_anew() -> None:
    cv = ConstantVelocity(gated=False)
    walk(cv)
    for i in range(30, 60):
        cv.update(HeadObservation(i * FRAME_S, np.array([9.0, 9.0, 0.4])))
        assert cv.rejections_in_a_row == 0
        assert cv.started_at_s == 0.0
    assert cv.forecast(2.0).issued_at_s == 59 * FRAME_S
    np.testing.assert_allclose(cv.state()[1][:3], [9.0, 9.0, 0.4], atol=0.05)


def test_head_pose_not_gated_takes_in_place_and_yaw_of_an_outlier() -> None:
    for gated in (False, True):
        head, kalman = HeadPose(gated=gated), ConstantVelocity(gated=gated)
        for predictor in (head, kalman):
            turned_walk(predictor, 30, angle=0.0, waist_yaw=0.3)
            predictor.update(HeadObservation(1.0, np.array([3.0, 5.0, 0.4]), yaw_quat(1.3), yaw_quat(0.3)))
        yaw = head.relative_yaw_rad()
        assert yaw is not None
        assert (yaw > 0.5) != gated
        _, x, _ = kalman.state()
        bent = x[3:] + Rotation.from_euler("z", yaw).apply(x[3:])
        np.testing.assert_allclose(head.forecast(1.5).means_base_m[0], x[:3] + 0.25 * bent, atol=1e-12)
