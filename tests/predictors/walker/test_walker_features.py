"""Inputs of `Walker`: filter bank against filterpy, running means, yaw filters, mountings and noise."""

import numpy as np
import pytest
from builders.people import yaw_quat
from builders.walkers import random_covariance
from filterpy.kalman import KalmanFilter
from scipy.spatial.transform import Rotation

from predictors import HeadObservation
from predictors.walker.bank import FILTERS, MEANS_S, N_YAW, YAW_MEANS_S
from predictors.walker.features import WalkerHistory

N_FILTERS, N_MEANS = len(FILTERS), len(MEANS_S)
# Blocks of the inputs.
OF_MEANS, OF_SWAY = 6 * N_FILTERS, 6 * N_FILTERS + 3 * N_MEANS
OF_YAWS = OF_SWAY + N_MEANS
AT_REST, LEFT = np.zeros(6), np.array([0.0, 0.0, 0.4, 0.0, 1.2, 0.0])


def inputs_of(times_s, positions_m, covariances_m2=None, line=AT_REST, pelvis=None, head=None):
    """Inputs after the last frame; stated covariances or None, yaws as functions of the time."""
    history = WalkerHistory()
    for k, (time_s, position_m) in enumerate(zip(times_s, positions_m, strict=True)):
        quats = [None if yaw is None or yaw(time_s) is None else yaw_quat(yaw(time_s)) for yaw in (head, pelvis)]
        stated_m2 = None if covariances_m2 is None else covariances_m2[k]
        own_m2 = history.white_noise_m2() if stated_m2 is None else stated_m2
        inputs = history.add(HeadObservation(time_s, position_m, *quats, stated_m2), line, own_m2)
    return inputs


def bank_of(times_s, positions_m, covariances_m2, psd, gait_m):
    """Position and velocity by filterpy."""
    kalman = KalmanFilter(6, 3)
    kalman.x = np.array([*positions_m[0], 0.0, 0.0, 0.0])
    kalman.P, kalman.H = np.diag([100.0**2] * 3 + [1.0] * 3), np.eye(3, 6)
    intervals_s = np.diff(times_s, prepend=times_s[0] - 1 / 30)
    for dt, position_m, covariance_m2 in zip(intervals_s, positions_m, covariances_m2, strict=True):
        frames = 30.0 * min(max(dt, 1e-3), 0.1)
        powers = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        kalman.F, kalman.Q = np.eye(6) + dt * np.eye(6, k=3), psd * np.kron(powers, np.eye(3))
        kalman.predict()
        kalman.update(position_m, R=covariance_m2 + (gait_m**2 / frames + 1e-6) * np.eye(3))
    return kalman.x


@pytest.mark.parametrize("rate_hz", [8.0, 30.0])
@pytest.mark.parametrize("sds_m", [(0.02, 0.01, 0.005), (0.3, 0.0014, 0.0014), (30.0, 0.003, 0.003)])
def test_the_bank_holds_constant_velocity_kalman_filters(rate_hz, sds_m):
    """Equal to filterpy over 300 irregular frames, also with covariances of condition up to 1e8 whose axes turn."""
    rng = np.random.default_rng(0)
    times_s = np.cumsum(rng.uniform(0.7, 1.3, 300)) / rate_hz
    covariances_m2 = [random_covariance(rng, sds_m) for _ in times_s]
    noise_m = np.array([rng.multivariate_normal(np.zeros(3), each) for each in covariances_m2])
    positions_m = 0.02 * np.sin(np.outer(times_s, [1.0, 0.7, 0.2])) + noise_m
    inputs = inputs_of(times_s, positions_m, covariances_m2)
    for k, (psd, gait_m) in enumerate(FILTERS):
        expected = bank_of(times_s, positions_m, covariances_m2, psd, gait_m)
        np.testing.assert_allclose(inputs.places_m[k], expected[:3], atol=1e-9)
        np.testing.assert_allclose(inputs.velocities_m_s[1 + k], np.clip(expected[3:], -0.6, 0.6), atol=1e-9)
        scaled = np.clip(expected / [0.05, 0.05, 0.05, 0.15, 0.15, 0.15], -4.0, 4.0)
        np.testing.assert_allclose(inputs.network[6 * k : 6 * k + 6], scaled, atol=1e-6)


def test_innovations_are_their_mean_squares_over_a_second_in_the_frame_of_the_line():
    """Of a person at rest, seen in turns 2 cm too far to the left and to the right."""
    times_s = np.arange(0.0, 8.0, 1 / 30)
    still = np.zeros((times_s.size, 3))
    quiet = inputs_of(times_s, still, line=LEFT).spread[12:].reshape(-1, 3)
    np.testing.assert_allclose(quiet, 0.5 * np.log(0.01), atol=0.02)
    shaken = still + np.outer((-1.0) ** np.arange(times_s.size), [0.02, 0.0, 0.0])
    found = inputs_of(times_s, shaken, line=LEFT).spread[12:].reshape(-1, 3)
    # The line leads to the left, so +x is to its right. A slow filter stays at the mean.
    np.testing.assert_allclose(found[-1], 0.5 * np.log([0.01, (0.02 / 0.014) ** 2 + 0.01, 0.01]), atol=0.04)
    assert np.all(found[:, 1] > found[-1, 1] - 0.02)
    np.testing.assert_allclose(found[:, [0, 2]], 0.5 * np.log(0.01), atol=0.04)
    # The prior, one, decays with the age of the track: 0.3 / (0.3 + 0.5) after half a second.
    early = inputs_of(times_s[:15], still[:15], line=LEFT).spread[12]
    assert np.exp(2.0 * early) - 0.01 == pytest.approx(0.3 / 0.8, rel=0.05)


def test_filters_and_means_are_in_the_frame_of_the_line():
    """A line that leads to the left, 2 cm behind and 3 cm/s slower than a steady walk."""
    times_s = np.arange(300) / 30.0
    positions_m = np.outer(times_s, [0.0, 1.2, 0.0])
    line = np.concatenate([positions_m[-1] - [0.0, 0.02, 0.0], [0.0, 1.17, 0.0]])
    inputs = inputs_of(times_s, positions_m, line=line)
    found = inputs.network[:OF_MEANS].reshape(-1, 2, 3)
    np.testing.assert_allclose(found[:, 0], np.tile([0.4, 0.0, 0.0], (N_FILTERS, 1)), atol=0.05)
    np.testing.assert_allclose(found[:, 1], np.tile([0.2, 0.0, 0.0], (N_FILTERS, 1)), atol=0.05)
    speeds_m_s = [1.17, *[1.2] * N_FILTERS]
    np.testing.assert_allclose(inputs.velocities_m_s, np.outer(speeds_m_s, [1.0, 0.0, 0.0]), atol=0.0075)
    np.testing.assert_allclose(inputs.to_base @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)


def test_velocities_of_the_filters_are_limited_relative_to_the_line():
    """A track that moves at -0.3 m/s along and 1.2 m/s across a line of 0.5 m/s to the left."""
    times_s = np.arange(300) / 30.0
    inputs = inputs_of(times_s, np.outer(times_s, [-1.2, -0.3, 0.0]), line=np.array([0.0, 0.0, 0.0, 0.0, 0.5, 0.0]))
    np.testing.assert_allclose(inputs.velocities_m_s[0], [0.5, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(inputs.velocities_m_s[1:], np.tile([-0.1, 0.6, 0.0], (N_FILTERS, 1)), atol=0.01)


@pytest.mark.parametrize("step_m", [0.3, 1.0])
@pytest.mark.parametrize("rate_hz", [2.5, 30.0])
def test_running_means_decay_exponentially_and_give_the_sway(rate_hz, step_m):
    """A step between two rests: each mean has the response 1 - exp(-t / memory).

    As a place of staying it fades to the newest position at 0.3 to 0.6 m from it.
    """
    times_s = np.arange(round(60 * rate_hz) + 1) / rate_hz
    positions_m = np.where(times_s[:, None] > 58.0, [0.0, step_m, 0.3], [0.0, 0.0, 0.3])
    inputs = inputs_of(times_s, positions_m)
    places_m = inputs.places_m[-N_MEANS:]
    behind_m = step_m * np.exp(-2.0 / np.array(MEANS_S))
    expected_m = step_m - behind_m * np.clip((0.6 - behind_m) / 0.3, 0.0, 1.0)
    np.testing.assert_allclose(places_m[:, 1], expected_m, atol=step_m * (0.15 / rate_hz + 0.02))
    np.testing.assert_allclose(places_m[:, [0, 2]], np.tile([0.0, 0.3], (N_MEANS, 1)), atol=1e-12)
    assert np.all(0.05 * np.exp(inputs.network[OF_SWAY:OF_YAWS]) > 0.2 * step_m)
    still = inputs_of(times_s, np.tile([0.0, 1.0, 0.3], (times_s.size, 1)))
    np.testing.assert_allclose(0.05 * np.exp(still.network[OF_SWAY:OF_YAWS]), 0.002)


# ---------------------------------------------------------------- yaws


FRAMES_S = np.arange(90) / 30.0
WALK = np.outer(FRAMES_S, [1.2, 0.0, 0.0])
AHEAD = np.array([0.0, 0.0, 0.4, 1.2, 0.0, 0.0])


def yaws_of(pelvis, times_s=FRAMES_S, line=AHEAD):
    """Low-pass filters of the pelvis yaw, radians."""
    inputs = inputs_of(times_s, WALK[: len(times_s)], line=line, pelvis=pelvis)
    return 0.15 * inputs.network[OF_YAWS : OF_YAWS + N_YAW]


def test_yaw_filters_have_their_time_constants_and_wrap():
    """A step from 170 to -170 deg, 20 deg to the left; a walk along -x."""
    back, taus_s = np.array([0.0, 0.0, 0.4, -1.2, 0.0, 0.0]), np.array(YAW_MEANS_S)
    low_rad = yaws_of(lambda t: np.radians(170.0 if t < 80.5 / 30 else -170.0), line=back)
    expected = np.radians(10.0 - 20.0 * (taus_s / (taus_s + 1 / 30)) ** 9)
    np.testing.assert_allclose(low_rad, expected, atol=1e-6)


def test_yaw_filters_are_held_without_an_observation_and_continue_with_the_interval():
    """A step of 0.2 rad after a gap of 0.5 s; within the gap the weight decays to zero."""
    taus_s = np.minimum(YAW_MEANS_S, 89 / 30 + 1e-9)
    low_rad = yaws_of(lambda t: 0.0 if t < 74.5 / 30 else None if t < 88.5 / 30 else 0.2)
    np.testing.assert_allclose(low_rad, 0.2 * (1.0 - taus_s / (taus_s + 0.5)), atol=1e-6)
    low_rad = yaws_of(lambda t: 0.2 if t < 82.5 / 30 else None)
    np.testing.assert_allclose(low_rad, 0.2 * (1.0 - 7 / 15), atol=1e-6)


def test_yaw_inputs_fade_out_at_rest_and_sideways():
    for speed_m_s, yaw_rad, share in ((1.2, 0.2, 1.0), (0.35, 0.2, 0.5), (0.1, 0.2, 0.0)):
        line = np.array([0.0, 0.0, 0.4, speed_m_s, 0.0, 0.0])
        np.testing.assert_allclose(yaws_of(lambda t, y=yaw_rad: y, line=line), share * yaw_rad, atol=1e-9)
    sideways = inputs_of(FRAMES_S[:3], WALK[:3], line=AHEAD, pelvis=lambda t: 1.65).network
    assert sideways[OF_YAWS] == pytest.approx(min(0.5 * 1.65 / 0.15, 4.0))


@pytest.mark.parametrize(
    ("offset_rad", "frames", "mounting"),
    [
        # Pelvis and head: a person's own offset; half of it a mounting; a mounting; half of one after 10 frames.
        ((0.2, 0.3), 60, (0.0, 0.0)),
        ((0.325, 0.425), 60, (0.1625, 0.2125)),
        ((-1.0, 2.0), 60, (-1.0, 2.0)),
        ((0.8, -0.9), 10, (0.4, -0.45)),
    ],
)
def test_size_and_duration_decide_whether_an_offset_is_a_mounting(offset_rad, frames, mounting):
    """Constant yaws on a straight walk: the residual offset is in the inputs."""
    pelvis, head = (lambda t, y=y: y for y in offset_rad)
    inputs = inputs_of(FRAMES_S[:frames], WALK[:frames], line=AHEAD, pelvis=pelvis, head=head)
    found = inputs.network[[OF_YAWS, OF_YAWS + N_YAW]]
    np.testing.assert_allclose(found, np.subtract(offset_rad, mounting) / [0.15, 0.2], atol=1e-6)


# ---------------------------------------------------------------- noise


@pytest.mark.parametrize("heading_rad", [0.0, 0.7, np.pi / 2])
def test_noise_inputs_are_along_across_and_up_without_saturation(heading_rad):
    """20 mm along, 10 across and 5 up, for any heading; a stated covariance is kept as it is."""
    turn = Rotation.from_euler("z", heading_rad).as_matrix()
    line = np.concatenate([np.zeros(3), turn @ [1.2, 0.0, 0.0]])
    for sds in (np.array([0.02, 0.01, 0.005]), np.array([30.0, 0.01, 1e-5])):
        covariance = turn @ np.diag(sds**2) @ turn.T
        inputs = inputs_of([0.0], [np.zeros(3)], [covariance], line)
        np.testing.assert_allclose(inputs.stated_m2, covariance, rtol=1e-12)
        logs = np.log(np.clip(sds / 0.01, 0.1, np.exp(4.0)))
        np.testing.assert_allclose(inputs.network[-4:-1], logs, atol=1e-6)
        assert np.abs(inputs.network).max() <= 4.0
    np.testing.assert_array_equal(inputs_of([0.0], [np.zeros(3)]).stated_m2, np.zeros((3, 3)))
