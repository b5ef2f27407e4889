"""The baseline predictors, each against an independent oracle."""

import numpy as np
import pytest
from builders.people import FRAME_S, PREDICTORS, yaw_quat
from scipy.integrate import quad_vec, solve_ivp
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from predictors import (
    ConstantVelocity,
    CoordinatedTurn,
    HeadObservation,
    InteractingModels,
    ParticleFilter,
    PelvisPursuit,
)
from predictors.baselines import coordinated_turn
from predictors.baselines.coordinated_turn import arc
from predictors.geometry import wrap_rad

ENDLESS_S = 1e6
SPEED_M_S, TURN_RAD_S = 1.2, 0.8
FILTERS = ("cv", "ca", "ctrv", "imm", "particle", "pursuit")


def on_circle(time_s, heading=0.3, rate=TURN_RAD_S):
    """Positions on a circle, by its centre and radius."""
    radius = SPEED_M_S / rate
    angle = heading + rate * np.asarray(time_s)
    return np.stack([2.0 + radius * np.sin(angle), 1.0 - radius * np.cos(angle), 1.6 + 0.0 * angle], axis=-1)


def straight(time_s):
    return np.array([2.0 - 1.1 * time_s, 1.0 + 0.3 * time_s, 1.6])


def show(predictor, path, frames=60, pelvis=None, head=None, noise_m=0.0):
    """Update with a walk at 30 Hz; returns the time of the last frame."""
    rng = np.random.default_rng(4)
    for i in range(frames):
        t = i * FRAME_S
        position = path(t) + noise_m * rng.standard_normal(3)
        quats = [None if yaw is None else yaw_quat(yaw(t)) for yaw in (head, pelvis)]
        predictor.update(HeadObservation(t, position, *quats))
    return (frames - 1) * FRAME_S


# ---------------------------------------------------------------- what all filters do


@pytest.mark.parametrize("name", FILTERS)
def test_false_detections_replace_the_track_only_after_0_75_s(name):
    """The false detections move, so that the new track has a velocity at once."""
    predictor = PREDICTORS[name]()
    end_s = show(predictor, straight, noise_m=0.005)
    aside = np.array([0.0, 0.6, 0.0])
    before = predictor.forecast(end_s + 0.5)
    for i in range(1, 24):
        predictor.update(HeadObservation(end_s + i * FRAME_S, straight(end_s + i * FRAME_S) + aside))
        after = predictor.forecast(end_s + 0.5)
        np.testing.assert_allclose(after.means_base_m, before.means_base_m, atol=0.01)
        assert after.issued_at_s == end_s
    new_s = end_s + 24 * FRAME_S
    predictor.update(HeadObservation(new_s, straight(new_s) + aside))
    forecast = predictor.forecast([new_s, new_s + 0.5])
    assert forecast.issued_at_s == new_s
    np.testing.assert_allclose(forecast.means_base_m[0], straight(new_s) + aside, atol=0.01)
    np.testing.assert_allclose(forecast.means_base_m[1], straight(new_s + 0.5) + aside, atol=0.1)


@pytest.mark.parametrize("name", FILTERS)
def test_a_gap_is_bridged_by_the_time_stamps(name):
    predictor = PREDICTORS[name]()
    end_s = show(predictor, straight)
    later_s = end_s + 0.7
    spread = predictor.forecast([later_s, later_s + 0.5]).covariances_m2
    assert np.linalg.det(spread[1]) > np.linalg.det(spread[0]) > 0
    predictor.update(HeadObservation(later_s, straight(later_s)))
    forecast = predictor.forecast(later_s + 0.5)
    assert forecast.issued_at_s == later_s
    np.testing.assert_allclose(forecast.means_base_m[0], straight(later_s + 0.5), atol=0.06)


# ---------------------------------------------------------------- coordinated turn


@pytest.mark.parametrize("rate", [-2.0, 0.0, 1.5])
def test_dying_turn_equals_an_ode_solver(rate):
    def derivative(_, y):
        return [np.cos(y[2]), np.sin(y[2]), y[3], -y[3] / 0.4]

    solved = solve_ivp(derivative, (0.0, 1.0), [0.0, 0.0, 0.3, rate], rtol=1e-10, atol=1e-12).y[:, -1]
    way, _ = arc(np.array(0.3), np.array(rate), np.array(1.0), 0.4)
    np.testing.assert_allclose(way, solved[:2], atol=1e-5)
    x = np.array([0.0, 0.0, 1.0, 0.3, rate, 0.1, -0.1])
    after, _ = coordinated_turn.transition(x, np.array(1.0), 0.4)
    np.testing.assert_allclose(after, [*solved[:2], 1.0, *solved[2:], 0.1, -0.1], atol=1e-5)


@pytest.mark.parametrize("rate", [-1.5, 0.0, 1e-9, 0.8])
@pytest.mark.parametrize("turn_time_s", [0.5, ENDLESS_S])
def test_the_jacobian_equals_finite_differences(rate, turn_time_s):
    x, dt, step = np.array([2.0, 1.0, 1.3, 0.4, rate, 0.1, -0.2]), np.array([0.03, 0.8]), 1e-6
    _, jacobian = coordinated_turn.transition(x, dt, turn_time_s)
    for i in range(7):
        change = step * np.eye(7)[i]
        up, _ = coordinated_turn.transition(x + change, dt, turn_time_s)
        down, _ = coordinated_turn.transition(x - change, dt, turn_time_s)
        np.testing.assert_allclose(jacobian[:, :, i], (up - down) / (2 * step), atol=1e-8)


def test_a_standing_person_has_the_constant_velocity_forecast():
    def sways(t):
        return np.array([2.0 + 0.02 * np.sin(3 * t), 1.0, 1.6 + 0.02 * np.cos(5 * t)])

    for cues in ("none", "pelvis", "both"):
        predictor, steady = CoordinatedTurn(yaw_cues=cues), ConstantVelocity()
        end_s = show(predictor, sways, pelvis=lambda t: 2.0 * t, head=lambda t: -3.0 * t)
        show(steady, sways)
        mine, expected = predictor.forecast(end_s + 0.5), steady.forecast(end_s + 0.5)
        np.testing.assert_array_equal(mine.means_base_m, expected.means_base_m)
        np.testing.assert_array_equal(mine.covariances_m2, expected.covariances_m2)


@pytest.mark.parametrize("heading", [0.4, np.pi - 0.02])
def test_a_constant_yaw_offset_is_estimated_and_keeps_the_walk_straight(heading):
    """Also where the measured yaws wrap from pi to -pi."""
    direction = np.array([np.cos(heading), np.sin(heading), 0.0])
    predictor = CoordinatedTurn(yaw_cues="both")
    end_s = show(
        predictor,
        lambda t: np.array([0.0, 0.0, 1.6]) + SPEED_M_S * t * direction,
        frames=200,
        pelvis=lambda t: heading + 0.08 + 0.05 * np.sin(6 * t),
        head=lambda t: heading - 0.2,
    )
    ahead = predictor.forecast(end_s + 0.5).means_base_m[0]
    np.testing.assert_allclose(ahead, [0.0, 0.0, 1.6] + SPEED_M_S * (end_s + 0.5) * direction, atol=0.02)


@pytest.mark.parametrize("cues", ["pelvis", "both"])
def test_a_turned_pelvis_bends_the_forecast_to_its_side(cues):
    def turns_at_the_end(t):
        return 0.6 * max(t - 1.6, 0.0)

    predictor, blind = CoordinatedTurn(yaw_cues=cues), CoordinatedTurn()
    for each in (predictor, blind):
        end_s = show(each, lambda t: np.array([1.2 * t, 0.0, 1.6]), pelvis=turns_at_the_end, head=turns_at_the_end)
    aside = [each.forecast(end_s + 0.5).means_base_m[0, 1] for each in (predictor, blind)]
    assert aside[0] > 0.02
    assert abs(aside[1]) < 1e-6


# ---------------------------------------------------------------- interacting models


def test_imm_equals_the_textbook_at_irregular_times():
    """Bar-Shalom, Li & Kirubarajan 2001, table 11.6.6-1, written out; per mode likelihoods from scipy."""
    rates_rad_s, psd, noise_m, mode_s = (0.0, 0.7, -0.7), 0.05, 0.01, 2.0
    predictor = InteractingModels(0.7, mode_s, psd, noise_m)
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.choice([0.02, 0.033, 0.1], 60))
    H, R = np.eye(3, 6), noise_m**2 * np.eye(3)
    xs, Ps, mu = np.zeros((3, 6)), np.array([np.diag([noise_m**2] * 3 + [1.0] * 3)] * 3), np.array([0.9, 0.05, 0.05])
    for k, t in enumerate(times):
        z = on_circle(t) + 0.01 * rng.standard_normal(3)
        predictor.update(HeadObservation(t, z))
        if k == 0:
            xs[:, :3] = z
            continue
        dt_s = t - times[k - 1]
        changes = expm((np.full((3, 3), 0.5) - 1.5 * np.eye(3)) * dt_s / mode_s)
        before = mu @ changes
        mixed, likelihood = [], np.zeros(3)
        for j in range(3):
            weights = changes[:, j] * mu / before[j]
            x0 = weights @ xs
            P0 = sum(w * (P + np.outer(x - x0, x - x0)) for w, x, P in zip(weights, xs, Ps, strict=True))
            A = np.zeros((6, 6))
            A[:3, 3:] = np.eye(3)
            A[3, 4], A[4, 3] = -rates_rad_s[j], rates_rad_s[j]
            F = expm(A * dt_s)
            x1 = F @ x0
            P1 = F @ P0 @ F.T + np.kron(psd * np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]]), np.eye(3))
            S = H @ P1 @ H.T + R
            K = P1 @ H.T @ np.linalg.inv(S)
            likelihood[j] = multivariate_normal(H @ x1, S).pdf(z)
            mixed.append((x1 + K @ (z - H @ x1), (np.eye(6) - K @ H) @ P1))
        xs, Ps = np.array([m[0] for m in mixed]), np.array([m[1] for m in mixed])
        mu = before * likelihood / (before @ likelihood)
    np.testing.assert_allclose(predictor.probabilities(), mu, rtol=1e-6)
    now = predictor.forecast(times[-1])
    mean = mu @ xs
    np.testing.assert_allclose(now.means_base_m[0], mean[:3], atol=1e-9)
    spread = sum(w * (P + np.outer(x - mean, x - mean)) for w, x, P in zip(mu, xs, Ps, strict=True))
    np.testing.assert_allclose(now.covariances_m2[0], spread[:3, :3], rtol=1e-6, atol=1e-12)


# ---------------------------------------------------------------- particle filter


def test_many_particles_agree_with_the_extended_kalman_filter():
    """Equal models; the particle filter's wider measurement noise is compensated."""
    particles, ekf = ParticleFilter(4000, position_noise_m=0.01), CoordinatedTurn(position_noise_m=0.015)
    for each in (particles, ekf):
        end_s = show(each, on_circle, frames=90, noise_m=0.01)
    times = end_s + np.array([0.0, 0.25, 0.5])
    mine, expected = particles.forecast(times), ekf.forecast(times)
    np.testing.assert_allclose(mine.means_base_m, expected.means_base_m, atol=0.02)
    deviations = [np.sqrt(np.trace(f.covariances_m2[:, :2, :2], axis1=1, axis2=2)) for f in (mine, expected)]
    np.testing.assert_allclose(deviations[0], deviations[1], rtol=0.3)


# ---------------------------------------------------------------- pelvis pursuit


@pytest.mark.parametrize("off_course", [-2.0, 0.0, 0.3])
def test_pursuit_is_the_integral_of_the_turned_velocity(off_course):
    heading = float(np.arctan2(0.3, -1.1))
    pursuit, steady = PelvisPursuit(0.6, 0.2, 0.05), ConstantVelocity(0.05)
    end_s = show(pursuit, straight, pelvis=lambda t: heading + off_course, noise_m=0.005)
    show(steady, straight, noise_m=0.005)
    _, x, _ = steady.state()
    turn = 0.6 * wrap_rad(heading + off_course - float(np.arctan2(x[4], x[3])))
    assert pursuit.turn_rad() == pytest.approx(turn, abs=1e-12)
    v = x[3:]
    turned = np.array([np.cos(turn) * v[0] - np.sin(turn) * v[1], np.sin(turn) * v[0] + np.cos(turn) * v[1], v[2]])
    for tau in (0.01, 0.3, 1.0):
        way, _ = quad_vec(lambda s: v + (1 - np.exp(-s / 0.2)) * (turned - v), 0.0, tau)
        np.testing.assert_allclose(pursuit.forecast(end_s + tau).means_base_m[0], x[:3] + way, atol=1e-9)


def test_pursuit_without_pelvis_or_gain_is_constant_velocity():
    blind, lazy, steady = PelvisPursuit(), PelvisPursuit(gain=0.0), ConstantVelocity(0.02)
    end_s = show(blind, straight, head=lambda t: 1.0)
    show(lazy, straight, pelvis=lambda t: 1.0)
    show(steady, straight)
    expected = steady.forecast(end_s + np.linspace(-0.2, 1.0, 5))
    for each in (blind, lazy):
        forecast = each.forecast(expected.times_s)
        np.testing.assert_allclose(forecast.means_base_m, expected.means_base_m, atol=1e-12)
        np.testing.assert_allclose(forecast.covariances_m2, expected.covariances_m2, atol=1e-12)
