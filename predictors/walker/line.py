"""Constant-velocity line of the recent walk, its frame, and the recent errors of its extrapolation."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from operator import itemgetter

from predictors.geometry import rotation_about_vertical
from predictors.types import FloatArray

_HORIZONS_S = (0.2, 0.5)
N_ERRORS = 3 * len(_HORIZONS_S)
# Tolerances of the time at which a forecast is compared with a frame.
_LATE_S, _EARLY_S = 0.25, 0.017
_MEMORY_S, _PRIOR_S = 1.0, 0.3
# Typical errors on walking people with the sensor `reference`: along, across and up, at each horizon.
_USUAL_M = ((0.025, 0.03, 0.02), (0.07, 0.09, 0.035))
_LARGEST_RATIO2, _SMALLEST_RATIO2 = 25.0, 0.01


@dataclass(frozen=True)
class Line:
    """Constant-velocity line of the recent walk.

    Attributes:
        time_s: Capture time of the newest observation.
        origin_base_m: Position at that time, shape (3,).
        velocity_base_m_s: Velocity, shape (3,).
        heading_rad: Horizontal direction of the velocity, about the vertical from +x.
    """

    time_s: float
    origin_base_m: FloatArray
    velocity_base_m_s: FloatArray
    heading_rad: float

    def to_base(self) -> FloatArray:
        """Rotation from the line's frame (along, across, up) to the base frame, shape (3, 3)."""
        return rotation_about_vertical(self.heading_rad)


class LineErrors:
    """Mean squares of the errors of recent lines, 0.2 and 0.5 s ahead.

    Plain floats: NumPy is several times slower for arrays this small.
    """

    def __init__(self) -> None:
        self._lines: list[tuple[float, ...]] = []  # time, origin and velocity of each
        self._ratio2 = [1.0] * N_ERRORS
        self._known_s = [0.0] * len(_HORIZONS_S)

    def learn(self, position_m: FloatArray, line: Line, stated_m2: FloatArray) -> list[float]:
        """Update with the errors of earlier lines at the newest position.

        Args:
            position_m: Smoothed position at the line's time, shape (3,), metres.
            line: The newest line; stored for later comparisons.
            stated_m2: Stated variances along, across and up, shape (3,), square metres; zeros if none are stated.

        Returns:
            Logarithms of the RMS errors relative to typical and stated error, N_ERRORS values.
        """
        lines = self._lines
        dt_s = min(line.time_s - lines[-1][0], _LATE_S) if lines else 0.0
        x, y, z = position_m.tolist()
        c, s = math.cos(line.heading_rad), math.sin(line.heading_rad)
        stated = stated_m2.tolist()
        for i, horizon_s in enumerate(_HORIZONS_S):
            until = bisect_right(lines, line.time_s - horizon_s + _EARLY_S, key=itemgetter(0))
            if not until or line.time_s - lines[until - 1][0] > horizon_s + _LATE_S:
                continue
            then_s, old_x, old_y, old_z, velocity_x, velocity_y, velocity_z = lines[until - 1]
            ahead_s = line.time_s - then_s
            off_x, off_y = x - old_x - ahead_s * velocity_x, y - old_y - ahead_s * velocity_y
            off = (c * off_x + s * off_y, c * off_y - s * off_x, z - old_z - ahead_s * velocity_z)
            gain = dt_s / (dt_s + min(self._known_s[i] + _PRIOR_S, _MEMORY_S))
            for k in range(3):
                ratio2 = min(off[k] * off[k] / (_USUAL_M[i][k] ** 2 + stated[k]), _LARGEST_RATIO2)
                self._ratio2[3 * i + k] += gain * (ratio2 - self._ratio2[3 * i + k])
            self._known_s[i] += dt_s
        expired = bisect_left(lines, line.time_s - _HORIZONS_S[-1] - _LATE_S, key=itemgetter(0))
        newest = line.time_s, *line.origin_base_m.tolist(), *line.velocity_base_m_s.tolist()
        self._lines = [*lines[expired:], newest]
        return [0.5 * math.log(ratio2 + _SMALLEST_RATIO2) for ratio2 in self._ratio2]
