"""Online estimate of a tracker's range error, from all detections including rejected ones."""

from __future__ import annotations

import math
from collections import deque
from operator import mul
from statistics import median_high

import numpy as np

from predictors.types import FloatArray, HeadObservation
from predictors.walker.noise import STEP_S, third_difference

# Lags of the third differences, frames: one for white noise, four for drift.
_LAGS = (1, 4)
# Longest span; the third difference over a longer one contains gait.
_SPAN_S = 0.45
_MEMORY_FRAMES, _PRIOR_FRAMES, _PRIOR_M = 30, 3, 0.01
# Standard deviation over median absolute deviation of a normal distribution.
_SD_OF_MEDIAN = 1.0 / 0.6745
# Level of gait and of typical trackers in these differences; `MeasuredNoise` estimates smaller errors.
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
        self._recent_m = [deque([_PRIOR_M] * _PRIOR_FRAMES, maxlen=_MEMORY_FRAMES) for _ in _LAGS]
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
            if d - a > _SPAN_S or min(b - a, c - b, d - c) < STEP_S:
                continue
            weights, norm = third_difference(a, b, c, d)
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
