"""Recursive estimates of a track in CasADi: white noise, filter bank, running means, low-pass filters of the yaws."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from predictors.constant_velocity import process_noise, transition
from predictors.types import FloatArray

# White noise of a tracker: prior standard deviation and its number of frames, memory; largest and smallest s.d.
PRIOR_M, PRIOR_FRAMES, MEMORY_FRAMES, _LARGEST_M, _SMALLEST_M = 0.01, 3, 30, 0.05, 0.002
# Longest span of four frames; the third difference over a longer one contains gait. Between the spans at 15 and at
# 14 frames a second, so rounding of the time stamps has no effect.
_SPAN_S = 0.207
# Shortest frame interval of a camera; a shorter one means two mixed sources or a clock step.
STEP_S = 1e-3
NEVER_S = 1e9  # interval before a track's first frame: effectively infinite
# State of the white noise: covariance without the floor (below 15 frames a second the prior), number of frames, the
# last three positions and the two intervals between them.
_COVARIANCE, _FRAMES, _POSITIONS, _INTERVALS = slice(0, 9), 9, slice(10, 19), slice(19, 21)
WHITE_AT_START = np.array([*(PRIOR_M**2 * np.eye(3)).ravel(), PRIOR_FRAMES, *[0.0] * 9, NEVER_S, NEVER_S])
_FLOOR_M2 = _SMALLEST_M**2 * np.eye(3)
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
# Usual frame interval, and the longest one with which the gait's variance scales.
USUAL_S, _LONGEST_S = 1.0 / 30.0, 0.1
# Prior s.d. of position and velocity of a filter, and rounding: a stated covariance may be nearly singular.
_FARTHEST_M, _SPEED_SD_M_S, _ROUNDING_M2 = 100.0, 1.0, 1e-6
# Mean squared innovations: unit, prior and memory, largest ratio to the unit.
INNOVATION_M, _PRIOR_S, _MEMORY_S, _LARGEST_RATIO2 = 0.014, 0.3, 1.0, 225.0
# Time constants of the running means, seconds: a standing person sways about the mean position.
MEANS_S = (1.0, 2.5, 6.0)
# Time constants of the low-pass filters of a yaw, seconds.
YAW_MEANS_S = (1e-3, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)

N_FILTERS, N_MEANS, N_YAW = len(FILTERS), len(MEANS_S), len(YAW_MEANS_S)
# States of a filter (position and velocity, their covariance, mean squared innovations), a mean (position, mean squared
# horizontal distance from it) and a yaw (newest yaw, time since it, low-pass filters relative to it).
SIZES = {"filter": 6 + 36 + 3, "mean": 4, "yaw": 2 + N_YAW}


class Compiled(threading.local):
    """A CasADi function of flat arrays, with one set of buffers per thread.

    A call takes a tenth of the time of a call that converts its arguments.

    Args:
        make: Returns the function, cached; called in each thread.
    """

    def __init__(self, make: Callable[[], ca.Function]) -> None:
        function = make()
        self._buffer: Any
        self._buffer, self._evaluate = function.buffer()
        self._arguments = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        self._results = [np.zeros(function.numel_out(k)) for k in range(function.n_out())]
        for k, array in enumerate(self._arguments):
            self._buffer.set_arg(k, array.data)
        for k, array in enumerate(self._results):
            self._buffer.set_res(k, array.data)

    def __call__(self, *arguments: FloatArray) -> list[FloatArray]:
        """Evaluate the function.

        Args:
            *arguments: Flat arrays, matrices column by column.

        Returns:
            Flat copies of the results, matrices column by column.
        """
        for array, value in zip(self._arguments, arguments, strict=True):
            array[:] = value
        self._evaluate()
        return [array.copy() for array in self._results]


def at_start(position_m: FloatArray) -> FloatArray:
    """State of filters, means and yaws before the first position, shape (3,), metres."""
    prior = np.diag([_FARTHEST_M**2] * 3 + [_SPEED_SD_M_S**2] * 3)
    one_filter = [*position_m, 0.0, 0.0, 0.0, *prior.ravel(), 1.0, 1.0, 1.0]
    one_yaw = [0.0, NEVER_S, *[0.0] * N_YAW]
    return np.array(one_filter * N_FILTERS + [*position_m, 0.0] * N_MEANS + one_yaw * 2)


def white_noise_m2(state: FloatArray) -> FloatArray:
    """Covariance of the white noise.

    Args:
        state: State, shape (21,), see `white_noise`.

    Returns:
        Shape (3, 3), square metres; standard deviation at least 2 mm in any direction.
    """
    return state[_COVARIANCE].reshape(3, 3) + _FLOOR_M2


def third_difference(times_s: Sequence[Any]) -> list[Any]:
    """Weights of the third divided difference.

    Args:
        times_s: Four distinct times, floats or CasADi expressions, seconds.

    Returns:
        Four weights, s^-3.
    """
    return [1.0 / math.prod(a - b for b in times_s if b is not a) for a in times_s]


def white_noise(state: ca.SX, position_m: ca.SX, dt_s: ca.SX) -> ca.SX:
    """Recursive estimate of the white noise from third divided differences, in which the motion of a walker is small.

    Args:
        state: State, shape (21,), at first `WHITE_AT_START`.
        position_m: The position, shape (3,), metres.
        dt_s: Time since the last one, seconds.

    Returns:
        The new state, shape (21,).
    """
    intervals_s = ca.vertcat(state[_INTERVALS], dt_s)
    before_s = [ca.sum1(intervals_s[k:]) for k in range(3)] + [0.0]
    weights = ca.vertcat(*third_difference(before_s))
    positions_m = ca.horzcat(ca.reshape(state[_POSITIONS], 3, 3), position_m)
    off_m = positions_m @ weights / ca.norm_2(weights)
    gain = 1.0 / ca.fmin(state[_FRAMES], MEMORY_FRAMES)
    # Larger differences are clipped to the norm of the largest noise: robust to outliers.
    share = gain * ca.fmin(1.0, 3.0 * _LARGEST_M**2 / ca.fmax(ca.sumsqr(off_m), _SMALLEST_M**2))
    covariance = (1.0 - gain) * state[_COVARIANCE] + share * ca.vec(off_m @ off_m.T)
    valid = ca.logic_and(before_s[0] <= _SPAN_S, ca.mmin(intervals_s) >= STEP_S)
    last = ca.vec(positions_m[:, 1:]), intervals_s[1:]
    return ca.vertcat(ca.if_else(valid, ca.vertcat(covariance, state[_FRAMES] + 1.0), state[: _POSITIONS.start]), *last)


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
    frames = ca.fmin(ca.fmax(dt_s, STEP_S), _LONGEST_S) / USUAL_S
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
    # A copy of the lower triangle: exactly symmetric, half the operations.
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
    """Low-pass filters of a yaw.

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
    low_rad = (yaw[2:] - wrap(seen_rad - yaw[0])) * memories_s / (memories_s + since_s)
    return ca.if_else(is_seen, ca.vertcat(seen_rad, 0.0, low_rad), ca.vertcat(yaw[0], since_s, yaw[2:]))


def wrap(angle_rad: ca.SX) -> ca.SX:
    """Angle in [-pi, pi]."""
    return ca.atan2(ca.sin(angle_rad), ca.cos(angle_rad))


def ramp(value: ca.SX, low: float, high: float) -> ca.SX:
    """Ramp from 0 at `low` to 1 at `high`."""
    return ca.fmin(ca.fmax((value - low) / (high - low), 0.0), 1.0)
