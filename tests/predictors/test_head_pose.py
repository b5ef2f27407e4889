"""Head pose: the paper's equations by hand; yaw relative to waist or travel, and with its mean removed."""

import numpy as np
import pytest
from builders.people import FRAME_S, seen, turned_walk, walk, yaw_quat
from scipy.spatial.transform import Rotation

from predictors import ConstantVelocity, HeadObservation, HeadPose
from predictors.geometry import wrap_rad


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("relative_yaw", [0.0, 0.4, -1.2])
def test_head_pose_is_the_papers_equations_1_to_5(weight, relative_yaw):
    """N = 15 steps of 1/30 s, with x(t|t) from a Kalman filter of the same positions."""
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


def test_head_pose_covariance_is_that_of_the_turned_state():
    weight, yaw, psd, tau = 0.6, 0.9, 0.05, 0.5
    head, kalman = HeadPose(weight=weight), ConstantVelocity()
    end_s = walk(head, frames=4, relative_yaw=yaw)  # after few frames position and velocity are correlated
    walk(kalman, frames=4)
    _, x, P = kalman.state()
    turn = Rotation.from_euler("z", yaw).as_matrix()
    M = np.hstack([np.eye(3), tau * ((1 - weight) * np.eye(3) + weight * turn)])
    expected = M @ P @ M.T + psd * tau**3 / 3 * np.eye(3)
    forecast = head.forecast(end_s + tau)
    np.testing.assert_allclose(forecast.covariances_m2[0], expected, atol=1e-12)
    np.testing.assert_allclose(forecast.means_base_m[0], M @ x, atol=1e-12)
    assert np.linalg.norm(P[:3, 3:]) > 1e-6


def test_a_yaw_expires_after_half_a_second():
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
    assert head.relative_yaw_rad() == pytest.approx(-0.2)  # the old yaw has no effect


@pytest.mark.parametrize("centre", [0.3, np.pi])
def test_relative_yaw_is_the_scalar_kalman_filter_of_a_random_walk(centre):
    """Head and waist past pi, and a difference about pi; psd 1 rad^2/s."""
    rng = np.random.default_rng(5)
    measured = centre + 0.05 * rng.standard_normal(20)
    head = HeadPose(yaw_noise_rad=0.05)
    estimate, variance = measured[0], 0.05**2
    for i, angle in enumerate(measured):
        head.update(seen(i * FRAME_S, np.ones(3), head_yaw=3.0 + angle, waist_yaw=3.0))
        if i:
            variance += FRAME_S
            gain = variance / (variance + 0.05**2)
            estimate, variance = estimate + gain * (angle - estimate), (1 - gain) * variance
        assert wrap_rad(head.relative_yaw_rad() - estimate) == pytest.approx(0.0, abs=1e-12)


def test_ungated_head_pose_uses_position_and_yaw_of_an_outlier():
    for gated in (False, True):
        head, kalman = HeadPose(gated=gated), ConstantVelocity(gated=gated)
        for predictor in (head, kalman):
            turned_walk(predictor, 30, angle=0.0, waist_yaw=0.3)
            predictor.update(HeadObservation(1.0, np.array([3.0, 5.0, 0.4]), yaw_quat(1.3), yaw_quat(0.3)))
        yaw = head.relative_yaw_rad()
        assert (yaw > 0.5) != gated
        _, x, _ = kalman.state()
        bent = x[3:] + Rotation.from_euler("z", yaw).apply(x[3:])
        np.testing.assert_allclose(head.forecast(1.5).means_base_m[0], x[:3] + 0.25 * bent, atol=1e-12)


@pytest.mark.parametrize("waist_yaw", [None, -2.0])
def test_yaw_from_travel_is_head_yaw_minus_path_heading(waist_yaw):
    """Independent of the waist orientation, known or unknown."""
    head, kalman = HeadPose(weight=1.0, yaw_from="travel"), ConstantVelocity()
    end_s = turned_walk(head, 60, waist_yaw=waist_yaw)
    turned_walk(kalman, 60)
    assert head.relative_yaw_rad() == pytest.approx(np.radians(20.0), abs=1e-9)
    now, ahead = kalman.forecast([end_s, end_s + 0.5]).means_base_m
    expected = now + Rotation.from_euler("z", 20.0, degrees=True).apply(ahead - now)
    np.testing.assert_allclose(head.forecast(end_s + 0.5).means_base_m[0], expected, atol=1e-9)


def test_removing_the_mean_keeps_yaw_oscillation():
    """The offset is the running mean of the filtered yaw."""
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


def test_a_new_track_resets_the_yaw_offset():
    """Refusals for 0.75 s, then a track 5 m away with opposite head yaw: only its own mean is removed."""
    head = HeadPose(yaw_from="travel", offset_removed=True)
    end_s = turned_walk(head, 90)
    start_s = end_s + FRAME_S
    last_s = turned_walk(head, 100, np.radians(-10.0), start_s=start_s, start_m=(2.0, 6.0, 0.4))
    expected = np.radians(-10.0) * 0.5 / (last_s - start_s + 0.5)  # the new track includes the refused observations
    assert head.relative_yaw_rad() == pytest.approx(expected, abs=np.radians(0.1))
    head.reset()
    turned_walk(head, 30)
    fresh = HeadPose(yaw_from="travel", offset_removed=True)
    turned_walk(fresh, 30)
    assert head.relative_yaw_rad() == fresh.relative_yaw_rad()


def test_an_unknown_reference_of_the_yaw_is_refused():
    with pytest.raises(ValueError, match="yaw_from must be waist or travel, got 'wasit'"):
        HeadPose(yaw_from="wasit")
