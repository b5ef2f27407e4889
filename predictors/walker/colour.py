"""The colour of a tracker's error: how fast it changes, from differences over several lags."""

from __future__ import annotations

import numpy as np

from predictors.types import FloatArray

_LAGS = (1, 2, 4)
_MEMORY = 45.0
_PRIOR = 12.0
_UNIT = np.array([0.01, 0.01, 0.01, 0.035, 0.035])
_PARTS = ((0, 1), (2,), (3,), (4,))


class ErrorColour:
    """Third differences over 1, 2 and 4 frames: equal for white error, growing for wander, small for a clean track."""

    def __init__(self) -> None:
        self._mean2 = np.ones((3, 5))
        self._frames = np.zeros(3)

    def learn(self, raw: FloatArray) -> FloatArray:
        """Take in the newest of the frames on the grid, shape (m, 5).

        Returns:
            Logarithms of horizontal and vertical differences over each lag, and of yaws over 1 and 4, shape (10,).
        """
        m = len(raw)
        for i, k in enumerate(_LAGS):
            if m <= 3 * k:
                continue
            d = (raw[-1] - 3 * raw[-1 - k] + 3 * raw[-1 - 2 * k] - raw[-1 - 3 * k]) / _UNIT
            d2 = np.minimum(d * d / 20.0, 25.0)
            self._frames[i] += 1
            self._mean2[i] += (d2 - self._mean2[i]) / min(self._frames[i] + _PRIOR, _MEMORY)
        l = 0.5 * np.log(self._mean2 + 0.01)
        h = 0.5 * np.log(self._mean2[:, :2].mean(axis=1) + 0.01)
        return np.array([*h, *l[:, 2], l[0, 3], l[2, 3], l[0, 4], l[2, 4]])
