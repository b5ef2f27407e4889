"""The predictor `walker` with any weights: symmetries, applicability, and the filter's part of the forecast."""

import numpy as np
import pytest
from builders.people import yaw_quat
from builders.walkers import AHEAD_S, forecasts, moved, random_covariance, random_model, seen_of, straight_model
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from predictors import ConstantVelocity, HeadObservation, Walker
from predictors.walker.features import LOG_SD
from predictors.walker.knots import BetweenKnots
from predictors.walker.network import N_OUTPUTS, VELOCITIES, WALKS

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
@example(angle_rad=0.5, shift_m=np.zeros(3), mirror=True, sensor="face_camera")
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
    to_base = walker.inputs().to_base  # near the walk's direction, with slow convergence under such noise
    assert np.arctan2(to_base[1, 0], to_base[0, 0]) == pytest.approx(heading_rad, abs=0.2)
    own_m2 = to_base @ np.diag([0.05, 0.1, 0.2]) ** 2 @ to_base.T
    factor = v / (v - 2.0) if v < np.inf else 1.0
    expected = factor * (own_m2 + 0.8**2 * noise_m2)
    forecast = walker.forecast(44 / 30 + np.array([0.0, 0.3, 1.5, 3.0]))
    expected = expected * np.array([1.0, 1.0, 1.0, 2.0**3])[:, None, None]
    np.testing.assert_allclose(forecast.covariances_m2, expected, rtol=1e-6, atol=1e-9)
    longest = np.linalg.eigh(forecast.covariances_m2[1])[1][:, 2]
    assert abs(longest @ np.linalg.eigh(noise_m2)[1][:, 2]) > 0.95


def test_blend_is_the_mixture_of_both_forecasts():
    """Mean and covariance of a two-part mixture, from moments; the logits are low-pass filtered."""
    walker, cv, model = Walker(random_model()), ConstantVelocity(), random_model()
    logits = np.zeros((2, N_OUTPUTS - WALKS))  # before the first frame: not walking, and at rest
    logits[:, 0], logits[:, VELOCITIES][:, 0] = -2.5, 4.0
    of_old = np.exp(-1 / 30 / np.array([0.1, *[0.6] * (logits.shape[1] - 1)]))
    for observation in walking_at(2.6):
        end_s = shown([observation], walker, cv)
        inputs = walker.inputs()
        if inputs.on_foot > 0.0:
            outputs = model.outputs(inputs.network)
            logits = outputs[:, WALKS:] + of_old * (logits - outputs[:, WALKS:])
            outputs[:, WALKS:] = logits
    share = inputs.on_foot
    assert 0.2 < share < 0.8
    mixed, plain = walker.forecast([end_s + 0.5]), cv.forecast([end_s + 0.5])
    departure_m, doubt = model.answer(outputs, inputs.spread, inputs.places_m, inputs.velocities_m_s)
    departure, sd = BetweenKnots(departure_m, model.spread_m(doubt))(np.array([0.5]))
    turn = inputs.to_base
    own = inputs.origin_base_m + 0.5 * inputs.velocity_base_m_s + turn @ departure[0]
    mean = share * own + (1 - share) * plain.means_base_m[0]
    own_m2 = turn @ np.diag(sd[0, :3] ** 2) @ turn.T + sd[0, 3] ** 2 * STATED_M2
    second = share * (own_m2 + np.outer(own, own))
    second += (1 - share) * (plain.covariances_m2[0] + np.outer(plain.means_base_m[0], plain.means_base_m[0]))
    np.testing.assert_allclose(mixed.means_base_m[0], mean, atol=1e-9)
    np.testing.assert_allclose(mixed.covariances_m2[0], second - np.outer(mean, mean), atol=1e-9)


def test_the_noise_of_a_precise_track_is_not_that_of_the_next():
    """2 mm, then 5 mm: the tracker's error is estimated for each track, from a prior of 10 mm."""
    walker, fresh, rng, begins = Walker(random_model()), Walker(random_model()), np.random.default_rng(0), []
    for k in range(60):
        walker.update(HeadObservation(k / 30, np.array([1.2 * k / 30, 0.0, 0.4]), yaw_quat(0.0), yaw_quat(0.0)))
    np.testing.assert_allclose(0.01 * np.exp(walker.inputs().network[LOG_SD]), 0.002, rtol=0.5)
    for k in range(60, 120):
        at_m = np.array([-3.0, 3.0 - k / 30, 0.5]) + 0.005 * rng.standard_normal(3)
        for each in (walker, fresh):
            each.update(HeadObservation(k / 30, at_m))
        if walker.inputs().time_s == k / 30:
            begins.append(k)
            noise, own_noise = (np.sort(each.inputs().network[LOG_SD]) for each in (walker, fresh))
            np.testing.assert_allclose(noise, own_noise, atol=0.02)
    assert len(begins) >= 30


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
            np.testing.assert_allclose(ours.origin_base_m, theirs.origin_base_m, atol=1e-9)
            np.testing.assert_allclose(ours.velocity_base_m_s, theirs.velocity_base_m_s, atol=1e-9)
            np.testing.assert_allclose(ours.network, theirs.network, atol=1e-9)
    assert begins[0] - 60 <= 30
    assert len(begins) >= 30
    at = walker.forecast([119 / 30]).means_base_m[0]
    np.testing.assert_allclose(at, [-3.0, 3.0 - 119 / 30, 0.5], atol=0.3)  # random weights
