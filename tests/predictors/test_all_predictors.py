"""Common properties of predictors: purity, refusals, covariances, and use of stated observation errors."""

from dataclasses import replace

import numpy as np
import pytest
from builders.people import FRAME_S, PREDICTORS, WALK_M_S, posterior, seen, velocity_kernel, walk, yaw_quat
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from predictors import (
    ConstantAcceleration,
    ConstantVelocity,
    HeadObservation,
    HeadPose,
    InteractingModels,
    LastPosition,
    NotReadyError,
    OutOfOrderError,
    Perfect,
    Walker,
    bearing_covariance,
)

MAKERS = PREDICTORS | {"walker": Walker, "perfect": lambda: Perfect(lambda times: np.outer(times, WALK_M_S))}
every_predictor = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS.keys())


@every_predictor
def test_forecasting_is_pure_and_independent_of_order(make):
    predictor = make()
    end_s = walk(predictor, relative_yaw=0.5)
    times_s = end_s + np.array([0.5, 0.0, 1.0, 0.25])
    first = predictor.forecast(times_s)
    shuffle = np.array([2, 0, 3, 1])
    again = predictor.forecast(times_s[shuffle])
    np.testing.assert_array_equal(again.times_s, times_s[shuffle])
    np.testing.assert_array_equal(again.means_base_m, first.means_base_m[shuffle])
    np.testing.assert_array_equal(again.covariances_m2, first.covariances_m2[shuffle])
    queried, unqueried = make(), make()
    for i in range(10):
        for each in (queried, unqueried):
            each.update(seen(i * FRAME_S, i * FRAME_S * WALK_M_S, head_yaw=0.1 * i))
        queried.forecast(i * FRAME_S + np.linspace(0.0, 2.0, 5))
    np.testing.assert_array_equal(queried.forecast(1.0).means_base_m, unqueried.forecast(1.0).means_base_m)
    np.testing.assert_array_equal(queried.forecast(1.0).covariances_m2, unqueried.forecast(1.0).covariances_m2)


@every_predictor
def test_no_forecast_before_the_first_observation_nor_after_reset(make):
    predictor = make()
    with pytest.raises(NotReadyError):
        predictor.forecast(0.0)
    walk(predictor, relative_yaw=0.5)
    predictor.reset()
    with pytest.raises(NotReadyError):
        predictor.forecast(0.0)
    fresh = make()
    for each in (predictor, fresh):  # after a reset an earlier clock is valid
        each.update(seen(-5.0, np.ones(3)))
    np.testing.assert_array_equal(predictor.forecast(-4.5).means_base_m, fresh.forecast(-4.5).means_base_m)
    assert predictor.forecast(-4.5).issued_at_s == -5.0


@every_predictor
@pytest.mark.parametrize("step_s", [0.0, -0.1])
def test_old_observations_are_refused_without_effect(make, step_s):
    predictor = make()
    end_s = walk(predictor, relative_yaw=0.5)
    before = predictor.forecast(end_s + 0.5)
    with pytest.raises(OutOfOrderError, match="not newer"):
        predictor.update(seen(end_s + step_s, np.array([50.0, 0.0, 0.0]), head_yaw=2.0))
    after = predictor.forecast(end_s + 0.5)
    np.testing.assert_array_equal(after.means_base_m, before.means_base_m)
    np.testing.assert_array_equal(after.covariances_m2, before.covariances_m2)


@every_predictor
@settings(max_examples=10)
@given(
    steps_s=st.lists(st.floats(1e-3, 2.0), min_size=1, max_size=15),
    places=arrays(np.float64, (15, 3), elements=st.floats(-5, 5)),
    yaws=arrays(np.float64, 15, elements=st.floats(-7, 7)),
    ahead_s=st.lists(st.floats(-0.5, 3.0), min_size=1, max_size=5),
)
def test_covariances_are_symmetric_and_positive_semidefinite(make, steps_s, places, yaws, ahead_s):
    """For any observations, jumps included."""
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


def test_last_position_is_constant_with_variance_of_walking_speed():
    last = LastPosition(position_noise_m=0.02, walking_speed_m_s=0.5)
    last.update(seen(1.0, np.array([9.0, 9.0, 9.0])))
    last.update(seen(2.0, np.array([1.0, 2.0, 3.0])))
    forecast = last.forecast([2.0, 2.4])
    np.testing.assert_array_equal(forecast.means_base_m, np.tile([1.0, 2.0, 3.0], (2, 1)))
    np.testing.assert_allclose(forecast.covariances_m2[0], 0.0004 * np.eye(3))
    np.testing.assert_allclose(forecast.covariances_m2[1], 0.0404 * np.eye(3))
    assert forecast.issued_at_s == 2.0


def test_perfect_gives_the_true_future_without_variance():
    perfect = Perfect(lambda times: np.stack([np.sin(times), times**2, np.ones_like(times)], axis=-1))
    perfect.update(seen(0.5, np.zeros(3)))
    forecast = perfect.forecast([0.5, 2.0])
    np.testing.assert_array_equal(forecast.means_base_m, [[np.sin(0.5), 0.25, 1.0], [np.sin(2.0), 4.0, 1.0]])
    assert not np.any(forecast.covariances_m2)
    assert forecast.issued_at_s == 0.5


# ---------------------------------------------------------------- what an observation states of its error


AHEAD_S = np.array([0.0, 0.25, 0.5, 1.0])
SENSOR_M = np.array([0.0, 0.0, 0.2])
EYE3 = np.eye(3)


def curve(frames=30, seed=0):
    """A person on a gentle curve; each frame's error is sampled from its stated covariance."""
    rng = np.random.default_rng(seed)
    time_s, heading = 0.0, 0.0
    place = np.array([2.5, -1.2, 0.4])
    observations = []
    for i in range(frames):
        sds = (0.01, 0.2) if i % 3 else (0.002, 0.05)
        covariance = bearing_covariance(place - SENSOR_M, *sds)
        seen_m = rng.multivariate_normal(place, covariance)
        quats = map(yaw_quat, heading + 0.05 * rng.standard_normal(2))
        observations.append(HeadObservation(time_s, seen_m, *quats, position_covariance_m2=covariance))
        step_s = FRAME_S * rng.uniform(0.5, 2.0)
        time_s += step_s
        heading += 0.4 * step_s
        place = place + 1.1 * step_s * np.array([np.cos(heading), np.sin(heading), 0.0])
    return observations


def acceleration_kernel(product, early, late, psd=0.3):
    """As `velocity_kernel`, with initial acceleration 0 +- 1 m/s^2 and white jerk."""
    apart = late - early
    return product + product**2 / 4 + psd * (early**5 / 5 + apart * early**4 / 2 + apart**2 * early**3 / 3) / 4


@pytest.mark.parametrize(
    ("predictor", "kernel"),
    [
        (ConstantVelocity(acceleration_psd=0.05), velocity_kernel(0.05)),
        (ConstantAcceleration(jerk_psd=0.3), acceleration_kernel),
        (InteractingModels(turn_rate_rad_s=1e-12, acceleration_psd=0.05), velocity_kernel(0.05)),
    ],
    ids=["cv", "ca", "imm whose modes all go straight"],
)
def test_forecasts_equal_the_exact_posterior_with_stated_covariances(predictor, kernel):
    observations = curve()
    for k, observation in enumerate(observations):
        predictor.update(observation)
        if k in (1, 8, len(observations) - 1):
            times_s = observation.capture_time_s + AHEAD_S
            means, covariances = posterior(observations[: k + 1], times_s, kernel)
            found = predictor.forecast(times_s)
            np.testing.assert_allclose(found.means_base_m, means, atol=1e-8)
            np.testing.assert_allclose(found.covariances_m2, covariances, rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize("make", PREDICTORS.values(), ids=PREDICTORS.keys())
def test_stated_noise_equals_configured_noise(make):
    """Configured noise has no effect where another is stated, except on particle roughening."""
    noise_m = 0.004
    configured, told = make(position_noise_m=noise_m), make(position_noise_m=0.01)
    for observation in curve():
        near = replace(observation, position_covariance_m2=None)
        configured.update(near)
        told.update(replace(near, position_covariance_m2=noise_m**2 * EYE3))
        times_s = observation.capture_time_s + AHEAD_S
        a, b = configured.forecast(times_s), told.forecast(times_s)
        np.testing.assert_allclose(a.means_base_m, b.means_base_m, atol=1e-6)
        np.testing.assert_allclose(a.covariances_m2, b.covariances_m2, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize(("yaw_from", "sds"), [("waist", (0.03, 0.06)), ("travel", (0.03, None))])
def test_the_head_yaw_is_filtered_with_its_stated_deviation(yaw_from, sds):
    """The variances of the relative yaw add; half of the default variance replaces an unstated one."""
    usual_rad = 0.05
    expected = sds[0] ** 2 + (usual_rad**2 / 2.0 if sds[1] is None else sds[1] ** 2)
    configured = HeadPose(yaw_noise_rad=np.sqrt(expected), yaw_from=yaw_from)
    told = HeadPose(yaw_noise_rad=usual_rad, yaw_from=yaw_from)
    for observation in curve():
        configured.update(observation)
        told.update(replace(observation, head_yaw_sd_rad=sds[0], pelvis_yaw_sd_rad=sds[1]))
    assert told.relative_yaw_rad() == pytest.approx(configured.relative_yaw_rad(), abs=1e-12)
