"""Online estimate of a tracker's range error, for trackers that do not state their covariance."""

from __future__ import annotations

import math
from collections import deque
from operator import mul, sub
from statistics import median_high

import numpy as np

from predictors.types import FloatArray, HeadObservation
from predictors.walker.bank import MEMORY_FRAMES, PRIOR_FRAMES, PRIOR_M, STEP_S, third_difference

# Lags of the third differences, frames: one for white noise, four for drift. Longest span; the third difference over a
# longer one contains gait.
_LAGS, _SPAN_S = (1, 4), 0.45
# Standard deviation over median absolute deviation of a normal distribution.
_SD_OF_MEDIAN = 1.0 / 0.6745
# Level of gait and of typical trackers in these differences; `bank.white_noise` estimates smaller errors.
_USUAL_M2 = 0.03**2
# Weight of the drift's variance, which disturbs the velocity more than white noise does; the best of those tried.
_DRIFT_COUNTS = 4.0
# Displacements with a larger component across the line of sight are attributed to a change of person and discarded.
_BESIDE_M, _BESIDE_SHARE = 0.05, 0.5
_NEAREST_M = 1e-3  # at the sensor the line of sight is undefined


class MeasuredRange:
    """Variance of the position along the line of sight in excess of gait.

    Median of the third differences: robust to one outlier in ten frames. The sensor is assumed at the origin. Plain
    floats: NumPy takes more than twice the time for arrays this small.

    Attributes:
        variance_m2: Variance of the range beyond that of usual trackers, square metres; 0 for those.
    """

    def __init__(self) -> None:
        self._frames: deque[tuple[float, ...]] = deque(maxlen=3 * _LAGS[-1] + 1)  # time and position of each
        self._recent_m = [deque([PRIOR_M] * PRIOR_FRAMES, maxlen=MEMORY_FRAMES) for _ in _LAGS]
        self.variance_m2 = 0.0

    def learn(self, observation: HeadObservation) -> None:
        """Update with a detection, before gating.

        Args:
            observation: The observation, newer than all before it.
        """
        position_m = observation.head_position_base_m.tolist()
        self._frames.append((observation.capture_time_s, *position_m))
        range_m = max(math.hypot(*position_m), _NEAREST_M)
        for lag, recent in zip(_LAGS, self._recent_m, strict=True):
            if len(self._frames) <= 3 * lag:
                break
            times_s, *columns = zip(*(self._frames[row] for row in range(-1 - 3 * lag, 0, lag)), strict=True)
            if times_s[3] - times_s[0] > _SPAN_S or min(map(sub, times_s[1:], times_s)) < STEP_S:
                continue
            weights = third_difference(times_s)
            off_m = [sum(map(mul, weights, column)) / math.hypot(*weights) for column in columns]
            along_m = abs(sum(map(mul, off_m, position_m))) / range_m
            if sum(map(mul, off_m, off_m)) - along_m**2 <= max(_BESIDE_M, _BESIDE_SHARE * along_m) ** 2:
                recent.append(along_m)
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
        if self.variance_m2 == 0.0:  # of usual trackers: saves a tenth of the time of an update
            return np.zeros((3, 3))
        range_m2 = max(float(position_m @ position_m), _NEAREST_M**2)
        return self.variance_m2 / range_m2 * np.outer(position_m, position_m)
