"""What an observation states of its error is used: by each filter as by its textbook, written out here."""

from dataclasses import replace

import numpy as np
import pytest
from builders.people import FRAME_S, PREDICTORS, yaw_quat

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


class Textbook:
    """Kalman filter of a chain of integrators on each axis, driven by white noise, in information form."""

    def __init__(self, order, psd, prior_sds):
        self.order, self.psd, self.prior_sds = order, psd, prior_sds
        self.x, self.P, self.time_s = None, None, 0.0

    def step(self, dt_s):
        n = self.order
        F = np.array([[dt_s ** (j - i) / np.prod(np.arange(1, j - i + 1)) if j >= i else 0.0 for j in range(n)]
                      for i in range(n)])  # fmt: skip
        # The noise's effect by Simpson's rule on a fine grid, which is exact for these polynomials to rounding.
        s, w = np.polynomial.legendre.leggauss(8)
        grid, weights = dt_s * (s + 1) / 2, dt_s * w / 2
        last = np.array([[g ** (n - 1 - i) / np.prod(np.arange(1, n - i)) for i in range(n)] for g in grid])
        Q = self.psd * np.einsum("k,ki,kj->ij", weights, last, last)
        return np.kron(F, EYE3), np.kron(Q, EYE3)

    def update(self, o):
        R, z = o.position_covariance_m2, o.head_position_base_m
        if self.x is None:
            self.x = np.concatenate([z, np.zeros(3 * (self.order - 1))])
            self.P = np.kron(np.diag([0.0, *np.square(self.prior_sds)]), EYE3)
            self.P[:3, :3] = R
        else:
            F, Q = self.step(o.capture_time_s - self.time_s)
            x, P = F @ self.x, F @ self.P @ F.T + Q
            information = np.linalg.inv(P)
            information[:3, :3] += np.linalg.inv(R)
            self.P = np.linalg.inv(information)
            self.x = self.P @ (np.linalg.inv(P) @ x + np.concatenate([np.linalg.solve(R, z), 0.0 * x[3:]]))
        self.time_s = o.capture_time_s

    def forecast(self, times_s):
        each = [self.step(t - self.time_s) for t in times_s]
        return np.array([(F @ self.x)[:3] for F, _ in each]), np.array(
            [(F @ self.P @ F.T + Q)[:3, :3] for F, Q in each]
        )


@pytest.mark.parametrize(
    ("predictor", "textbook"),
    [
        (ConstantVelocity(acceleration_psd=0.05), Textbook(2, 0.05, [1.0])),
        (ConstantAcceleration(jerk_psd=0.3), Textbook(3, 0.3, [1.0, 1.0])),
        (InteractingModels(turn_rate_rad_s=1e-12, acceleration_psd=0.05), Textbook(2, 0.05, [1.0])),
    ],
    ids=["cv", "ca", "imm whose modes all go straight"],
)
def test_it_is_the_textbook_s_filter_with_that_covariance(predictor, textbook):
    for observation in curve():
        predictor.update(observation)
        textbook.update(observation)
        times_s = observation.capture_time_s + AHEAD_S
        means, covariances = textbook.forecast(times_s)
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


def test_a_range_that_is_stated_as_unknown_does_not_shake_the_direction():
    """Errors of 0.5 m along the line of sight: who takes them for positions is led far astray."""

    def worst_deg(stated):
        rng, predictor, errors = np.random.default_rng(0), ConstantVelocity(), []
        for i in range(90):
            true_m = np.array([2.5, -1.4 + 0.03 * i, 0.3])
            sight = true_m / np.linalg.norm(true_m)
            seen_m = true_m + 0.3 * rng.standard_normal() * sight
            covariance = bearing_covariance(seen_m, 0.003, 0.3) if stated else None
            predictor.update(HeadObservation(i * FRAME_S, seen_m, position_covariance_m2=covariance))
            then_m = np.array([2.5, true_m[1] + 0.03 * 7.5, 0.3])
            forecast_m = predictor.forecast(i * FRAME_S + 0.25).means_base_m[0]
            cosine = forecast_m @ then_m / np.linalg.norm(forecast_m) / np.linalg.norm(then_m)
            errors.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
        return np.sqrt(np.mean(np.square(errors[45:])))

    assert worst_deg(stated=True) < 1.5
    assert worst_deg(stated=False) > 2.0 * worst_deg(stated=True)


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
