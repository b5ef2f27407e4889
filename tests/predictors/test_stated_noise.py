"""What an observation states of its error is used: by each filter as by its textbook, written out here."""

from dataclasses import replace

import numpy as np
import pytest
from builders.people import FRAME_S, PREDICTORS, posterior, velocity_kernel, yaw_quat

from predictors import (
    ConstantAcceleration,
    ConstantVelocity,
    HeadObservation,
    HeadPose,
    InteractingModels,
    bearing_covariance,
)

AHEAD_S = np.array([0.0, 0.25, 0.5, 1.0])
SENSOR_M = np.array([0.0, 0.0, 0.2])
EYE3 = np.eye(3)


def curve(frames=30, seed=0):
    """A person comes round a gentle curve; each frame's error is drawn from the covariance that it states."""
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
    """As `velocity_kernel`, with an acceleration of 0 +- 1 m/s^2 that white noise drives."""
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
def test_it_is_the_exact_posterior_with_that_covariance(predictor, kernel):
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
def test_stating_the_noise_of_every_frame_is_to_set_it(make):
    """And a noise that is set counts for nothing where another is stated, but for how particles are shaken."""
    noise_m = 0.004
    set_to_it, told = make(position_noise_m=noise_m), make(position_noise_m=0.01)
    for observation in curve():
        near = replace(observation, position_covariance_m2=None)
        set_to_it.update(near)
        told.update(replace(near, position_covariance_m2=noise_m**2 * EYE3))
        times_s = observation.capture_time_s + AHEAD_S
        a, b = set_to_it.forecast(times_s), told.forecast(times_s)
        np.testing.assert_allclose(a.means_base_m, b.means_base_m, atol=1e-6)
        np.testing.assert_allclose(a.covariances_m2, b.covariances_m2, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize(("yaw_from", "sds"), [("waist", (0.03, 0.06)), ("travel", (0.03, None))])
def test_the_head_s_yaw_is_filtered_with_the_stated_spread(yaw_from, sds):
    """Of the relative yaw the variances add up; half of the usual variance stands for what is not stated."""
    usual_rad = 0.05
    expected = sds[0] ** 2 + (usual_rad**2 / 2.0 if sds[1] is None else sds[1] ** 2)
    set_to_it = HeadPose(yaw_noise_rad=np.sqrt(expected), yaw_from=yaw_from)
    told = HeadPose(yaw_noise_rad=usual_rad, yaw_from=yaw_from)
    for observation in curve():
        set_to_it.update(observation)
        told.update(replace(observation, head_yaw_sd_rad=sds[0], pelvis_yaw_sd_rad=sds[1]))
    assert told.relative_yaw_rad() == pytest.approx(set_to_it.relative_yaw_rad(), abs=1e-12)
