"""Online estimates of a tracker's error: covariance of the white noise, and variance of the range."""

from __future__ import annotations

import math
from collections import deque
from operator import mul
from statistics import median_high
from typing import Any

import casadi as ca
import numpy as np

from predictors.types import FloatArray, HeadObservation

PRIOR_M, _PRIOR_FRAMES, _MEMORY_FRAMES = 0.01, 3, 30
_LARGEST_M, _SMALLEST_M = 0.05, 0.002
# Longest span of four frames; the third difference over a longer one contains gait. Between the spans at 15 and at
# 14 frames a second, so rounding of the time stamps has no effect.
_SPAN_S = 0.207
# Shortest frame interval of a camera; a shorter one means two mixed sources or a clock step.
_STEP_S = 1e-3
NEVER_S = 1e9  # interval to a frame that does not exist


def third_difference(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Any, Any, Any]:
    """Weights of the third divided difference of four frames.

    Args:
        a: Time of the first frame, seconds, a number or a CasADi expression; the others follow.
        b: Time of the second.
        c: Time of the third.
        d: Time of the fourth.

    Returns:
        The weight of each frame; their Euclidean norm is the gain for white noise.
    """
    return (
        1.0 / ((a - b) * (a - c) * (a - d)),
        1.0 / ((b - a) * (b - c) * (b - d)),
        1.0 / ((c - a) * (c - b) * (c - d)),
        1.0 / ((d - a) * (d - b) * (d - c)),
    )


# State of the white noise: covariance without its floor, number of frames, share of measurements in the covariance
# (0 below 15 frames a second; the rest is the prior), the last three positions and the two intervals between them.
_COVARIANCE, _FRAMES, SHARE, _POSITIONS, _INTERVALS = slice(0, 9), 9, 10, slice(11, 20), slice(20, 22)
WHITE_AT_START = np.array([*(PRIOR_M**2 * np.eye(3)).ravel(), _PRIOR_FRAMES, 0.0, *[0.0] * 9, NEVER_S, NEVER_S])


def white_noise(state: ca.SX, position_m: ca.SX, dt_s: ca.SX) -> ca.SX:
    """Recursive estimate of the white noise from third differences, in which the motion of a walker is small.

    Args:
        state: State, shape (22,), at first `WHITE_AT_START`.
        position_m: The position, shape (3,), metres.
        dt_s: Time since the last one, seconds.

    Returns:
        The new state.
    """
    intervals_s = ca.vertcat(state[_INTERVALS], dt_s)
    weights = ca.vertcat(*third_difference(-ca.sum1(intervals_s), -ca.sum1(intervals_s[1:]), -dt_s, 0.0))
    positions_m = ca.horzcat(ca.reshape(state[_POSITIONS], 3, 3), position_m)
    off_m = positions_m @ weights / ca.norm_2(weights)
    gain = 1.0 / ca.fmin(state[_FRAMES], _MEMORY_FRAMES)
    # A larger difference counts as one of the largest noise.
    share = gain * ca.fmin(1.0, 3.0 * _LARGEST_M**2 / ca.fmax(ca.sumsqr(off_m), _SMALLEST_M**2))
    estimate = ca.vertcat(
        (1.0 - gain) * state[_COVARIANCE] + share * ca.vec(off_m @ off_m.T),
        state[_FRAMES] + 1.0,
        state[SHARE] + gain * (1.0 - state[SHARE]),
    )
    valid = ca.logic_and(ca.sum1(intervals_s) <= _SPAN_S, ca.mmin(intervals_s) >= _STEP_S)
    return ca.vertcat(
        ca.if_else(valid, estimate, state[: _POSITIONS.start]), ca.vec(positions_m[:, 1:]), intervals_s[1:]
    )


_FLOOR_M2 = _SMALLEST_M**2 * np.eye(3)


def white_noise_m2(state: FloatArray) -> FloatArray:
    """Covariance of the white noise, shape (3, 3), square metres; standard deviation at least 2 mm in any direction."""
    return state[_COVARIANCE].reshape(3, 3) + _FLOOR_M2


# Lags of the third differences of the range, frames: one for white noise, four for drift.
_LAGS = (1, 4)
# Longest span; the third difference over a longer one contains gait.
_RANGE_SPAN_S = 0.45
# Standard deviation over median absolute deviation of a normal distribution.
_SD_OF_MEDIAN = 1.0 / 0.6745
# Level of gait and of typical trackers in these differences; `white_noise` estimates smaller errors.
_USUAL_M2 = 0.03**2
# Weight of the drift's variance, which disturbs the velocity more than white noise does; the best of those tried.
_DRIFT_COUNTS = 4.0
# A larger displacement across the line of sight is a change of person: no range error.
_BESIDE_M, _BESIDE_SHARE = 0.05, 0.5
_NEAREST_M = 1e-3  # at the sensor the line of sight is undefined


class MeasuredRange:
    """Variance of the position along the line of sight in excess of gait.

    Median of the third differences: robust to one outlier in ten frames. The sensor is assumed at the origin. Plain
    floats: NumPy is several times slower for arrays this small.

    Attributes:
        variance_m2: Variance of the range beyond that of usual trackers, square metres; 0 for those.
    """

    def __init__(self) -> None:
        # Time, range and direction of each frame.
        self._frames: deque[tuple[float, ...]] = deque(maxlen=3 * _LAGS[-1] + 1)
        self._recent_m = [deque([PRIOR_M] * _PRIOR_FRAMES, maxlen=_MEMORY_FRAMES) for _ in _LAGS]
        self.variance_m2 = 0.0

    def learn(self, observation: HeadObservation) -> None:
        """Update with a detection, before gating.

        Args:
            observation: The observation, newer than all before it.
        """
        x, y, z = observation.head_position_base_m.tolist()
        range_m = math.hypot(x, y, z)
        away_m = max(range_m, _NEAREST_M)
        self._frames.append((observation.capture_time_s, range_m, x / away_m, y / away_m, z / away_m))
        for lag, recent in zip(_LAGS, self._recent_m, strict=True):
            if len(self._frames) <= 3 * lag:
                break
            (a, b, c, d), *columns = zip(*(self._frames[row] for row in range(-1 - 3 * lag, 0, lag)), strict=True)
            if d - a > _RANGE_SPAN_S or min(b - a, c - b, d - c) < _STEP_S:
                continue
            weights = third_difference(a, b, c, d)
            norm = math.hypot(*weights)
            off_m, *turned = (sum(map(mul, weights, column)) / norm for column in columns)
            if range_m * math.hypot(*turned) <= max(_BESIDE_M, _BESIDE_SHARE * abs(off_m)):
                recent.append(abs(off_m))
        white_m2, slow_m2 = ((_SD_OF_MEDIAN * median_high(recent)) ** 2 for recent in self._recent_m)
        drift_m2 = max(slow_m2 - max(white_m2, _USUAL_M2), 0.0)
        self.variance_m2 = max(white_m2 - _USUAL_M2, 0.0) + _DRIFT_COUNTS * drift_m2

    def covariance_m2(self, position_m: FloatArray) -> FloatArray:
        """Covariance of rank one along the line of sight.

        Args:
            position_m: The observed position, shape (3,), metres.

        Returns:
            Covariance, shape (3, 3), square metres; zero across the line of sight.
        """
        range_m2 = max(float(position_m @ position_m), _NEAREST_M**2)
        return np.asarray(self.variance_m2 / range_m2 * np.outer(position_m, position_m))
