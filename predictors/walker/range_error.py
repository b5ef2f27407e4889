"""How wrong a tracker's ranges are, measured on all that it reports, also on what the gate refuses."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import deque

import numpy as np

from predictors.types import FloatArray, HeadObservation

# Third differences over so many frames: of one frame for white error, of four for an error that drifts.
_LAGS = (1, 4)
# Longer stretches bend with the walk itself; frames closer together than any camera's are of a clock that was set.
_SPAN_S, _STEP_S = 0.45, 1e-3
_MEMORY_FRAMES, _PRIOR_FRAMES, _PRIOR_M = 30, 3, 0.01
# Standard deviation of a normal error over the median of its size.
_SD_OF_MEDIAN = 1.0 / 0.6745
# What gait and the usual trackers do to such differences; smaller errors are measured with their directions elsewhere.
_USUAL_M2 = 0.03**2
# A drift disturbs the velocity more than white error of that size: this factor of its variance did best.
_DRIFT_COUNTS = 4.0
# A change in one step, as to another person, is no drift: farther off than this many standard deviations.
_JUMP_SDS = 5.0
_NEAREST_M = 1e-3  # a position at the sensor has no line of sight


class MeasuredRange:
    """Variance of a position along the line of sight, where the range errs more than gait explains.

    The median of the third differences is robust: one frame in ten may be far off. The sensor is assumed at the origin.
    """

    def __init__(self) -> None:
        self._times_s: deque[float] = deque(maxlen=3 * _LAGS[-1] + 1)
        self._ranges_m: deque[float] = deque(maxlen=3 * _LAGS[-1] + 1)
        self._recent_m = [deque([_PRIOR_M] * _PRIOR_FRAMES, maxlen=_MEMORY_FRAMES) for _ in _LAGS]
        self._sorted_m = [list(recent) for recent in self._recent_m]
        self._frames_since_jump = 0

    def learn(self, observation: HeadObservation) -> None:
        """Take in a reported position, before any gate.

        Args:
            observation: The observation, newer than all before it.
        """
        self._times_s.append(observation.capture_time_s)
        self._ranges_m.append(math.hypot(*observation.head_position_base_m.tolist()))
        for lag, recent, ordered in zip(_LAGS, self._recent_m, self._sorted_m, strict=True):
            jumped = lag > 1 and self._frames_since_jump <= 3 * (lag - 1)
            if len(self._times_s) <= 3 * lag or jumped:
                return
            rows = range(-1 - 3 * lag, 0, lag)
            a, b, c, d = (self._times_s[row] for row in rows)
            if d - a > _SPAN_S or min(b - a, c - b, d - c) < _STEP_S:
                continue
            weights = (
                1.0 / ((a - b) * (a - c) * (a - d)),
                1.0 / ((b - a) * (b - c) * (b - d)),
                1.0 / ((c - a) * (c - b) * (c - d)),
                1.0 / ((d - a) * (d - b) * (d - c)),
            )
            off_m = sum(weight * self._ranges_m[row] for weight, row in zip(weights, rows, strict=True))
            size_m = abs(off_m) / math.hypot(*weights)
            if lag == 1:
                jumps = size_m > _JUMP_SDS * max(_sd_m(ordered), _PRIOR_M)
                self._frames_since_jump = 0 if jumps else self._frames_since_jump + 1
            if len(recent) == _MEMORY_FRAMES:
                del ordered[bisect_left(ordered, recent[0])]
            recent.append(size_m)
            insort(ordered, size_m)

    def variance_m2(self) -> float:
        """Variance of the range beyond that of usual trackers, square metres; 0 for those."""
        white_m2, slow_m2 = (_sd_m(ordered) ** 2 for ordered in self._sorted_m)
        drift_m2 = max(slow_m2 - max(white_m2, _USUAL_M2), 0.0)
        return max(white_m2 - _USUAL_M2, 0.0) + _DRIFT_COUNTS * drift_m2

    def covariance_m2(self, position_m: FloatArray) -> FloatArray:
        """That variance as a covariance, shape (3, 3), square metres.

        Args:
            position_m: The observed position, shape (3,), metres.

        Returns:
            A covariance that is zero across the line of sight.
        """
        range_m2 = max(float(position_m @ position_m), _NEAREST_M**2)
        return np.asarray(self.variance_m2() / range_m2 * np.outer(position_m, position_m))


def _sd_m(ordered_m: list[float]) -> float:
    return _SD_OF_MEDIAN * ordered_m[len(ordered_m) // 2]
