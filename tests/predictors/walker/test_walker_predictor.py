"""The predictor `walker` with any weights: symmetries, applicability, and the filter's part of the forecast."""

import math

import numpy as np
import pytest
from builders.people import yaw_quat
from builders.walkers import AHEAD_S, forecasts, moved, random_covariance, random_model, seen_of, straight_model
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from predictors import ConstantVelocity, HeadObservation, Walker
from predictors.walker.between import BetweenKnots
from predictors.walker.features import WalkerHistory
from predictors.walker.network import RegimeMotion
from predictors.walker.window import WINDOW

GAIT_M2 = 0.02**2 * np.eye(3)
STATED_M2 = np.diag([0.012, 0.01, 0.008]) ** 2


def walking_at(speed_m_s, frames=45, noise_m=0.0, seed=0):
    """A straight walk with a stated position covariance."""
    rng = np.random.default_rng(seed)
    for k in range(frames):
        position = np.array([speed_m_s * k / 30, 1.0, 0.4]) + noise_m * rng.standard_normal(3)
        yield HeadObservation(k / 30, position, yaw_quat(0.3), yaw_quat(0.1), position_covariance_m2=STATED_M2)


def shown(observations, *predictors):
    for observation in observations:
        for predictor in predictors:
            if isinstance(predictor, Walker):
                predictor.update(observation)
            else:  # the line's filter treats gait as noise
                predictor.update_with(observation, GAIT_M2, GAIT_M2)
    return observation.capture_time_s


@settings(max_examples=8)
@given(
    angle_rad=st.floats(-np.pi, np.pi),
    shift_m=st.tuples(*[st.floats(-5, 5)] * 3).map(np.array),
    mirror=st.booleans(),
    sensor=st.sampled_from(["reference", "face_camera", "street", "body_tracker"]),
)
def test_the_forecast_is_equivariant_to_position_heading_and_reflection(angle_rad, shift_m, mirror, sensor):
    """The forecast moves, turns and is mirrored with the walk, covariance and all, from the first frame on.

    With wander above 30 mm the line of sight matters, so translation invariance does not hold.
    """
    if sensor in ("street", "body_tracker"):
        shift_m = np.zeros(3)
    observations = seen_of("subject02_R5", sensor)[20:45]
    model = random_model()
    means, covariances = forecasts(observations, walker=Walker(model))
    others = [moved(o, angle_rad, shift_m, mirror) for o in observations]
    other_means, other_covariances = forecasts(others, walker=Walker(model))
    turn = Rotation.from_euler("z", angle_rad).as_matrix() @ np.diag([1.0, -1.0 if mirror else 1.0, 1.0])
    np.testing.assert_allclose(other_means, means @ turn.T + shift_m, atol=1e-5)
    np.testing.assert_allclose(other_covariances, turn @ covariances @ turn.T, atol=1e-5)


@pytest.mark.parametrize(("speed_m_s", "frames"), [(4.0, 60), (0.0, 1), (1.2, 1)])
def test_running_and_unknown_headings_use_the_filter_forecast(speed_m_s, frames):
    walker, cv = Walker(random_model()), ConstantVelocity()
    end_s = shown(walking_at(speed_m_s, frames), walker, cv)
    ours, plain = walker.forecast(end_s + AHEAD_S), cv.forecast(end_s + AHEAD_S)
    np.testing.assert_array_equal(ours.means_base_m, plain.means_base_m)
    np.testing.assert_array_equal(ours.covariances_m2, plain.covariances_m2)


@pytest.mark.parametrize("speed_m_s", [0.05, 2.0])
def test_zero_departures_give_the_filter_line(speed_m_s):
    """With networks of zero departure; standing people included."""
    walker, cv = Walker(straight_model(0.1, 4.0)), ConstantVelocity()
    end_s = shown(walking_at(speed_m_s, noise_m=0.01), walker, cv)
    ours, plain = walker.forecast(end_s + AHEAD_S), cv.forecast(end_s + AHEAD_S)
    np.testing.assert_allclose(ours.means_base_m, plain.means_base_m, atol=1e-12)
    # The variance of a t distribution with 4 degrees of freedom is twice its scale's square.
    np.testing.assert_allclose(ours.covariances_m2, np.tile(2 * 0.1**2 * np.eye(3), (AHEAD_S.size, 1, 1)), atol=1e-9)
    assert ours.degrees_of_freedom == 4.0
    assert ours.issued_at_s == end_s


@pytest.mark.parametrize("heading_rad", [1.1, 3.0])
@pytest.mark.parametrize("v", [4.0, np.inf])
def test_observation_noise_keeps_its_principal_axes(heading_rad, v):
    """A share of the noise is added to the scale in the line's frame, for any heading; beyond 1.5 s both grow."""
    noise_m2 = random_covariance(np.random.default_rng(1), [0.3, 0.02, 0.01])
    model = straight_model(0.1, v, 0.8)
    model.log_spread[0] += np.log([0.5, 1.0, 2.0])
    walker, turn = Walker(model), Rotation.from_euler("z", heading_rad).as_matrix()
    for k in range(45):
        at = turn @ [1.2 * k / 30, 1.0, 0.4]
        walker.update(HeadObservation(k / 30, at, position_covariance_m2=noise_m2))
    line = walker.inputs().line  # near the walk's direction, with slow convergence under such noise
    assert line.heading_rad == pytest.approx(heading_rad, abs=0.2)
    own_m2 = line.to_base() @ np.diag([0.05, 0.1, 0.2]) ** 2 @ line.to_base().T
    factor = v / (v - 2.0) if v < np.inf else 1.0
    expected = factor * (own_m2 + 0.8**2 * noise_m2)
    forecast = walker.forecast(44 / 30 + np.array([0.0, 0.3, 1.5, 3.0]))
    expected = expected * np.array([1.0, 1.0, 1.0, 2.0**3])[:, None, None]
    np.testing.assert_allclose(forecast.covariances_m2, expected, rtol=1e-6, atol=1e-9)
    longest = np.linalg.eigh(forecast.covariances_m2[1])[1][:, 2]
    assert abs(longest @ np.linalg.eigh(noise_m2)[1][:, 2]) > 0.95


def test_blend_is_the_mixture_of_both_forecasts():
    """Mean and covariance of a two-part mixture, from moments; the evidence of a walk is low-pass filtered (0.1 s)."""
    walker, cv, model = Walker(random_model()), ConstantVelocity(), random_model()
    evidence = None
    for observation in walking_at(2.6):
        end_s = shown([observation], walker, cv)
        inputs = walker.inputs()
        if inputs.on_foot > 0.0:
            motion = RegimeMotion(inputs.line_m_s[None], inputs.places_m[None])
            newest = model.regimes(inputs.network[None], motion, np.array([inputs.precise])).evidence
            evidence = newest if evidence is None else newest + np.exp(-1 / 30 / 0.1) * (evidence - newest)
    share = inputs.on_foot
    assert 0.2 < share < 0.8
    mixed, plain = walker.forecast([end_s + 0.5]), cv.forecast([end_s + 0.5])
    motion = RegimeMotion(inputs.line_m_s[None], inputs.places_m[None])
    regimes = model.regimes(inputs.network[None], motion, np.array([inputs.precise]))
    departures, doubt = model.answer(regimes, inputs.spread[None], evidence)
    departure, sd = BetweenKnots(departures[0], model.spread_m(doubt)[0])(np.array([0.5]))
    turn = inputs.line.to_base()
    own = inputs.line.origin_base_m + 0.5 * inputs.line.velocity_base_m_s + turn @ departure[0]
    mean = share * own + (1 - share) * plain.means_base_m[0]
    own_m2 = turn @ np.diag(sd[0, :3] ** 2) @ turn.T + sd[0, 3] ** 2 * STATED_M2
    second = share * (own_m2 + np.outer(own, own))
    second += (1 - share) * (plain.covariances_m2[0] + np.outer(plain.means_base_m[0], plain.means_base_m[0]))
    np.testing.assert_allclose(mixed.means_base_m[0], mean, atol=1e-9)
    np.testing.assert_allclose(mixed.covariances_m2[0], second - np.outer(mean, mean), atol=1e-9)


def test_a_track_restarted_elsewhere_has_no_memory():
    """As a new track of the observations there; estimates of the person are reset."""
    walker, fresh = Walker(random_model()), Walker(random_model())
    for k in range(60):
        walker.update(HeadObservation(k / 30, np.array([1.2 * k / 30, 0.0, 0.4]), yaw_quat(1.0), yaw_quat(1.0)))
    begins = []
    for k in range(60, 120):
        observation = HeadObservation(k / 30, [-3.0, 3.0 - k / 30, 0.5], position_covariance_m2=STATED_M2)
        fresh.update(observation)
        walker.update(observation)
        if walker.forecast([3.0]).issued_at_s == k / 30:
            begins.append(k)
            ours, theirs = walker.inputs(), fresh.inputs()
            np.testing.assert_allclose(ours.line.origin_base_m, theirs.line.origin_base_m, atol=1e-9)
            np.testing.assert_allclose(ours.line.velocity_base_m_s, theirs.line.velocity_base_m_s, atol=1e-9)
            path = slice(0, 5 * WINDOW + 2)  # positions, yaws and offsets; colours depend on the frame count
            np.testing.assert_allclose(ours.network[path], theirs.network[path], atol=1e-9)
    assert begins[0] - 60 <= 30
    assert len(begins) >= 30
    at = walker.forecast([119 / 30]).means_base_m[0]
    np.testing.assert_allclose(at, [-3.0, 3.0 - 119 / 30, 0.5], atol=0.3)  # random weights


# ---------------------------------------------------------------- network inputs


STATE = np.array([0.0, 0.0, 0.4, 1.2, 0.0, 0.0])


def test_position_inputs_are_in_the_frame_of_the_line():
    """A walk to the left whose head is 4 cm off to its own left, ten frames ago: one unit across."""
    history = WalkerHistory()
    velocity = np.array([0.0, 1.2, 0.0])
    for k in range(60):
        at = np.array([1.0, 1.2 * k / 30, 0.4])
        seen = at - [0.04 if k == 49 else 0.0, 0.0, 0.0]
        surely = 1e-8 * np.eye(3)
        inputs = history.add(HeadObservation(k / 30, seen), np.concatenate([at, velocity]), surely, 1.0)
    assert inputs.line.heading_rad == pytest.approx(np.pi / 2)
    positions = inputs.network[: 3 * WINDOW].reshape(WINDOW, 3)
    expected = np.zeros((WINDOW, 3))
    expected[-11, 1] = 1.0
    np.testing.assert_allclose(positions, expected, atol=0.01)


def test_yaw_inputs_are_relative_to_the_line_and_zero_at_rest():
    def yaws(speed):
        history = WalkerHistory()
        for k in range(40):
            seen = HeadObservation(k / 30, [speed * k / 30, 0, 0.4], yaw_quat(0.2), yaw_quat(0.15))
            state = np.array([speed * k / 30, 0.0, 0.4, speed, 0.0, 0.0])
            inputs = history.add(seen, state, 1e-4 * np.eye(3), 1.0)
        return inputs.network[3 * WINDOW : 5 * WINDOW].reshape(WINDOW, 2)

    np.testing.assert_allclose(yaws(1.2), 1.0)  # pelvis over 0.15, head over 0.2
    np.testing.assert_allclose(yaws(0.35), 0.5)
    np.testing.assert_array_equal(yaws(0.1), 0.0)


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
    """Constant yaws on a straight walk: the residual offset is in the inputs and in the offset estimate."""
    history = WalkerHistory()
    for k in range(frames):
        state = STATE + np.array([1.2 * k / 30, 0, 0, 0, 0, 0])
        pelvis, head = map(yaw_quat, offset_rad)
        inputs = history.add(HeadObservation(k / 30, state[:3], head, pelvis), state, 1e-4 * np.eye(3), 1.0)
    left_rad = np.subtract(offset_rad, mounting)
    yaws = inputs.network[3 * WINDOW : 5 * WINDOW].reshape(WINDOW, 2)
    np.testing.assert_allclose(yaws[-1], left_rad / [0.15, 0.2], atol=1e-6)
    learned = inputs.network[5 * WINDOW : 5 * WINDOW + 2]
    np.testing.assert_allclose(learned, np.clip(left_rad * frames / (frames + 15.0) / 0.1, -4.0, 4.0), atol=1e-6)


@pytest.mark.parametrize(
    ("frames", "white_m", "share", "stated", "wander_m", "weight"),
    [
        (12, 0.002, 1.0, False, 0.0, 0.0),  # too short for a difference over four frames
        (16, 0.002, 1.0, False, 0.0, 4.0 * (1.0 - 21.0 / 25.0)),  # full weight at a share of a quarter
        (30, 0.002, 1.0, False, 0.0, 1.0),
        (30, 0.00285, 1.0, False, 0.0, 0.5),  # from 3.2 mm to 2.5 mm
        (30, math.sqrt(0.8 * 0.00285**2 + 0.2 * 0.01**2), 0.8, False, 0.0, 0.5),
        (30, math.sqrt(0.1 * 0.002**2 + 0.9 * 0.01**2), 0.1, False, 0.0, 0.4),
        (30, 0.01, 0.0, False, 0.0, 0.0),  # a slow tracker: nothing is measured
        (30, 0.002, 0.0, True, 0.0, 1.0),
        (30, math.sqrt(0.8 * 0.00285**2 + 0.2 * 0.01**2), 0.8, True, 0.0, 0.0),  # a stated error has no prior
        (30, 0.004, 1.0, False, 0.0, 0.0),
        (30, 0.002, 1.0, False, 0.02, 0.0),
    ],
)
def test_precision_is_independent_of_the_prior(frames, white_m, share, stated, wander_m, weight):
    """A straight walk, with a sway that changes sign every four frames."""
    history, covariance_m2 = WalkerHistory(), white_m**2 * np.eye(3)
    for k in range(frames):
        state = STATE + np.array([1.2 * k / 30, wander_m * (-1.0) ** (k // 4), 0, 0, 0, 0])
        seen = HeadObservation(k / 30, state[:3], position_covariance_m2=covariance_m2 if stated else None)
        inputs = history.add(seen, state, covariance_m2, share)
    assert inputs.precise == pytest.approx(weight, abs=1e-6)


@pytest.mark.parametrize("heading_rad", [0.0, 0.7, np.pi / 2])
def test_noise_inputs_are_along_across_and_up_without_saturation(heading_rad):
    """20 mm along, 10 across and 5 up, for any heading; large noise is not clipped, unlike in the network inputs."""
    turn = Rotation.from_euler("z", heading_rad).as_matrix()
    for sds in (np.array([0.02, 0.01, 0.005]), np.array([30.0, 0.01, 1e-5])):
        covariance = turn @ np.diag(sds**2) @ turn.T
        state = np.concatenate([np.zeros(3), turn @ [1.2, 0.0, 0.0]])
        for stated, given_m2 in enumerate((None, covariance)):
            seen = HeadObservation(0.0, state[:3], position_covariance_m2=given_m2)
            inputs = WalkerHistory().add(seen, state, covariance, 1.0)
            np.testing.assert_allclose(inputs.stated_sd_m, stated * sds, rtol=1e-3, atol=1e-6)
            np.testing.assert_array_equal(inputs.stated_base_m2, stated * covariance)
            assert np.abs(inputs.network).max() <= 4.0
