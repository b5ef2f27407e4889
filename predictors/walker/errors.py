"""How far the line's own forecasts were off: it tells of trackers that wander and of people who are not steady."""

from __future__ import annotations

from bisect import bisect_left, bisect_right

import numpy as np

from predictors.types import FloatArray
from predictors.walker.line import Line

_HORIZONS_S = (0.2, 0.5)
N_ERRORS = 3 * len(_HORIZONS_S)
# A forecast is compared with the first frame after its time, if that comes no later than this.
_LATE_S, _EARLY_S = 0.25, 0.017
_MEMORY_S, _PRIOR_S = 1.0, 0.3
# Errors of a line through people who walk, seen by the sensor `reference`: along, across and up.
_USUAL_M2 = np.array([[0.025, 0.03, 0.02], [0.07, 0.09, 0.035]]) ** 2
_LARGEST_RATIO2, _SMALLEST_RATIO2 = 25.0, 0.01


class LineErrors:
    """Mean squares of the errors of recent lines, 0.2 and 0.5 s ahead."""

    def __init__(self) -> None:
        self._lines: list[Line] = []
        self._times_s: list[float] = []
        self._ratio2 = np.ones((len(_HORIZONS_S), 3))
        self._known_s = [0.0] * len(_HORIZONS_S)

    def learn(self, position_m: FloatArray, line: Line, to_line: FloatArray, stated_m2: FloatArray) -> FloatArray:
        """Compare the newest position with the forecasts for it.

        Args:
            position_m: Smoothed position at the line's time, shape (3,), metres.
            line: The newest line, which is kept.
            to_line: Rotation from the base frame to the line's, shape (3, 3), to be multiplied from the right.
            stated_m2: Variances that the tracker states, along, across and up, shape (3,); zeros where it states none.

        Returns:
            Logarithms of the errors' size over the usual and the stated one, shape (N_ERRORS,).
        """
        lines, times_s = self._lines, self._times_s
        dt_s = min(line.time_s - times_s[-1], _LATE_S) if lines else 0.0
        for i, horizon_s in enumerate(_HORIZONS_S):
            until = bisect_right(times_s, line.time_s - horizon_s + _EARLY_S)
            if not until or line.time_s - times_s[until - 1] > horizon_s + _LATE_S:
                continue
            old = lines[until - 1]
            ahead_s = line.time_s - old.time_s
            off = (position_m - old.origin_base_m - ahead_s * old.velocity_base_m_s) @ to_line
            ratio2 = off * off / (_USUAL_M2[i] + stated_m2)
            gain = dt_s / (dt_s + min(self._known_s[i] + _PRIOR_S, _MEMORY_S))
            self._ratio2[i] += gain * (np.minimum(ratio2, _LARGEST_RATIO2) - self._ratio2[i])
            self._known_s[i] += dt_s
        gone = bisect_left(times_s, line.time_s - _HORIZONS_S[-1] - _LATE_S)
        self._lines, self._times_s = [*lines[gone:], line], [*times_s[gone:], line.time_s]
        return np.asarray(0.5 * np.log(self._ratio2.ravel() + _SMALLEST_RATIO2))
