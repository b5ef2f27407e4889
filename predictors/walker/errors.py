"""How far the line's own forecasts were off: measures what a tracker does not state, and how steady a person walks."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from predictors.types import FloatArray

_HORIZONS_S = (0.2, 0.5)
_MEMORY_S = 1.0
# Errors of a line through walking people seen by a good tracker, metres, along, across and up.
_USUAL_M = np.array([[0.025, 0.03, 0.02], [0.07, 0.09, 0.035]])
_PRIOR_S = 0.3


class ForecastMemory:
    """Errors of recent forecasts of the line, at 0.2 and 0.5 s, along, across and up."""

    def __init__(self) -> None:
        self._lines: deque[tuple[float, FloatArray, FloatArray]] = deque()
        self._squares = np.ones((2, 3))
        self._known_s = [0.0, 0.0]
        self._last_s: float | None = None

    def learn(
        self, times_s: FloatArray, position_m: FloatArray, now_s: float, origin: FloatArray, velocity: FloatArray, to_line: FloatArray
    ) -> FloatArray:
        """Compare the newest position with what was forecast for it.

        Returns:
            Logarithm of the errors' size over the usual one, shape (6,).
        """
        dt_s = 0.0 if self._last_s is None else min(now_s - self._last_s, 0.2)
        self._last_s = now_s
        lines = self._lines
        for i, horizon_s in enumerate(_HORIZONS_S):
            # the newest line that is at least the horizon old
            found = None
            for line in reversed(lines):
                if now_s - line[0] >= horizon_s - 0.017:
                    found = line
                    break
            if found is None or now_s - found[0] > horizon_s + 0.25:
                continue
            off = (position_m - found[1] - (now_s - found[0]) * found[2]) @ to_line / _USUAL_M[i]
            gain = dt_s / (dt_s + min(self._known_s[i] + _PRIOR_S, _MEMORY_S))
            self._squares[i] += gain * (np.minimum(off**2, 25.0) - self._squares[i])
            self._known_s[i] += dt_s
        lines.append((now_s, origin, velocity))
        while now_s - lines[0][0] > _HORIZONS_S[-1] + 0.3:
            lines.popleft()
        return 0.5 * np.log(self._squares.ravel() + 0.01)
