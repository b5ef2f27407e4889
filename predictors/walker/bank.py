"""Recursive estimates of a track as CasADi expressions: filter bank, running means, low-pass filters of the yaws."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from predictors.constant_velocity import process_noise, transition
from predictors.types import FloatArray
from predictors.walker.noise import NEVER_S

# Constant-velocity filters: power spectral density of the acceleration, m^2/s^3, and s.d. of gait as measurement noise
# at 30 frames a second, metres. Time constants from one frame to 0.8 s separate a tracker's noise, gait, a tracker's
# drift and a change of direction.
FILTERS = (
    (1.0, 0.0),
    (1.0, 0.03),
    (0.3, 0.03),
    (0.1, 0.05),
    (0.05, 0.1),
    (0.05, 0.21),
    (0.05, 0.42),
    (0.0125, 0.42),
)
# Limits of the frame interval with which the gait's variance scales.
USUAL_S, _SHORTEST_S, _LONGEST_S = 1.0 / 30.0, 1e-3, 0.1
# Prior s.d. of position and velocity of a filter, and rounding: a stated covariance may be nearly singular.
_FARTHEST_M, _SPEED_SD_M_S, _ROUNDING_M2 = 100.0, 1.0, 1e-6
# Mean squared innovations: unit, prior and memory, largest ratio to the unit.
INNOVATION_M, _PRIOR_S, _MEMORY_S, _LARGEST_RATIO2 = 0.014, 0.3, 1.0, 225.0
# Time constants of the running means, seconds: a standing person sways about the mean position.
MEANS_S = (1.0, 2.5, 6.0)
# Time constants of the low-pass filters of a yaw; frequency of a stride, and decay time of the resonator.
YAW_MEANS_S, _STRIDE_HZ, _DECAY_S = (1e-3, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6), 0.9, 0.7

N_FILTERS, N_MEANS, N_YAW = len(FILTERS), len(MEANS_S), len(YAW_MEANS_S) + 2
# States of a filter (position and velocity, their covariance, mean squared innovations), a mean (position, mean squared
# horizontal distance from it) and a yaw (newest yaw, time since it, low-pass filters relative to it, resonator).
SIZES = {"filter": 6 + 36 + 3, "mean": 4, "yaw": 2 + N_YAW}


def at_start(position_m: FloatArray) -> FloatArray:
    """State of filters, means and yaws before the first position, shape (3,), metres."""
    prior = np.diag([_FARTHEST_M**2] * 3 + [_SPEED_SD_M_S**2] * 3)
    one_filter = [*position_m, 0.0, 0.0, 0.0, *prior.ravel(), 1.0, 1.0, 1.0]
    one_yaw = [0.0, NEVER_S, *[0.0] * N_YAW]
    return np.array(one_filter * N_FILTERS + [*position_m, 0.0] * N_MEANS + one_yaw * 2)


def filtered(filters: ca.SX, position_m: ca.SX, noise_m2: ca.SX, dt_s: Any, age_s: ca.SX, to_line: ca.SX) -> ca.SX:
    """Measurement update of the Kalman filters, with white-noise acceleration and the Joseph form of the covariance.

    Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001.

    Args:
        filters: Their states, shape (45, N_FILTERS), see `SIZES`.
        position_m: The position, shape (3,), metres.
        noise_m2: Its covariance, shape (3, 3), square metres.
        dt_s: Time since the last position, seconds.
        age_s: Age of the track at the last position, seconds.
        to_line: Rotation from the base frame to the line's, shape (3, 3).

    Returns:
        The new states, shape (45, N_FILTERS).
    """
    F: Any = transition(dt_s)
    frames = ca.fmin(ca.fmax(dt_s, _SHORTEST_S), _LONGEST_S) / USUAL_S
    forgets = dt_s / (dt_s + ca.fmin(age_s + _PRIOR_S, _MEMORY_S))
    new = []
    for (psd, gait_m), old in zip(FILTERS, ca.horzsplit(filters), strict=True):
        x, P, squares = F @ old[:6], ca.reshape(old[6:42], 6, 6), old[42:]
        Q: Any = process_noise(dt_s, psd)
        P = _symmetric(F @ P @ F.T + Q)
        R = noise_m2 + (gait_m**2 / frames + _ROUNDING_M2) * np.eye(3)
        # LDL' factors: minors of the matrix cancel with a stated covariance of condition 1e8.
        K = ca.ldl_solve(P[:3, :], *ca.ldl(P[:3, :3] + R, False)).T
        innovation_m = position_m - x[:3]
        # Joseph form, as in `ConstantVelocity`: the short form diverges with R of condition 1e4.
        rest = ca.SX.eye(6) - ca.horzcat(K, ca.SX(6, 3))
        P = _symmetric(rest @ P @ rest.T + K @ R @ K.T)
        ratio2 = ca.fmin((to_line @ innovation_m / INNOVATION_M) ** 2, _LARGEST_RATIO2)
        new.append(ca.vertcat(x + K @ innovation_m, ca.vec(P), squares + forgets * (ratio2 - squares)))
    return ca.horzcat(*new)


def _symmetric(matrix: ca.SX) -> ca.SX:
    # The upper triangle is not computed.
    return ca.tril2symm(ca.tril(matrix))


def averaged(means: ca.SX, position_m: ca.SX, dt_s: ca.SX, age_s: ca.SX) -> ca.SX:
    """Running means of the position, and mean squared horizontal distances from them.

    Args:
        means: Their states, shape (4, N_MEANS), see `SIZES`.
        position_m: The newest position, shape (3,), metres.
        dt_s: Time since the last one, seconds.
        age_s: Age of the track at the last one, seconds.

    Returns:
        The new states, shape (4, N_MEANS).
    """
    new = []
    for memory_s, old in zip(MEANS_S, ca.horzsplit(means), strict=True):
        gain = dt_s / (ca.fmin(age_s, memory_s) + dt_s)
        off_m = position_m - old[:3]
        new.append(old + gain * ca.vertcat(off_m, (1.0 - gain) * ca.sumsqr(off_m[:2]) - old[3]))
    return ca.horzcat(*new)


def followed(yaw: ca.SX, seen_rad: ca.SX, is_seen: ca.SX, dt_s: ca.SX, age_s: ca.SX) -> ca.SX:
    """Low-pass filters of a yaw, and a resonator at the frequency of a stride.

    Args:
        yaw: The state, shape (2 + N_YAW,), see `SIZES`.
        seen_rad: Observed yaw, radians.
        is_seen: 1 if it is observed in this frame; else 0, and the filters are held.
        dt_s: Time since the last frame, seconds.
        age_s: Age of the track at the last frame, seconds.

    Returns:
        The new state, shape (2 + N_YAW,).
    """
    since_s = yaw[1] + dt_s
    memories_s = ca.fmin(ca.DM(YAW_MEANS_S), age_s)
    low_rad = (yaw[2:-2] - wrap(seen_rad - yaw[0])) * memories_s / (memories_s + since_s)
    # The slowest low-pass filter removes the mean; the gain makes the output of the order of the amplitude.
    decay, angle = ca.exp(-since_s / _DECAY_S), 2.0 * math.pi * _STRIDE_HZ * since_s
    c, s = decay * ca.cos(angle), decay * ca.sin(angle)
    real = c * yaw[-2] - s * yaw[-1] - 2.0 * (1.0 - decay) * low_rad[-1]
    new = ca.vertcat(seen_rad, 0.0, low_rad, real, s * yaw[-2] + c * yaw[-1])
    return ca.if_else(is_seen, new, ca.vertcat(yaw[0], since_s, yaw[2:]))


def wrap(angle_rad: ca.SX) -> ca.SX:
    """Angle in [-pi, pi]."""
    return ca.atan2(ca.sin(angle_rad), ca.cos(angle_rad))


def ramp(value: ca.SX, low: float, high: float) -> ca.SX:
    """Ramp from 0 at `low` to 1 at `high`."""
    return ca.fmin(ca.fmax((value - low) / (high - low), 0.0), 1.0)
