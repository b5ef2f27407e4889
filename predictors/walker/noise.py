"""How noisy a tracker is, from what it sees: the part of its error that changes from frame to frame."""

from __future__ import annotations

import numpy as np

from predictors.types import FloatArray

_PRIOR_M, _PRIOR_FRAMES, _MEMORY_FRAMES = 0.01, 3.0, 30.0
_LARGEST_M, _SMALLEST_M = 0.05, 0.002
# Four frames farther apart than this bend with the walk itself, and say nothing of noise. Between the spans of four
# frames at 15 and at 14 frames a second, so that rounding does not decide.
_SPAN_S = 0.207
# Frames closer together than any camera's: two sources, or a clock that was set.
_STEP_S = 1e-3


class MeasuredNoise:
    """Covariance of a position's white error, measured while the tracker runs.

    The third divided difference of a walk is next to nothing, so what is left of it is noise.
    """

    def __init__(self) -> None:
        self._covariance_m2 = _PRIOR_M**2 * np.eye(3)
        self._frames = _PRIOR_FRAMES

    def learn(self, times_s: FloatArray, positions_m: FloatArray) -> None:
        """Take in the newest position.

        Args:
            times_s: Times of the window, shape (N,), the newest last.
            positions_m: Positions, shape (N, 3).
        """
        if times_s.size < 4:  # noqa: PLR2004
            return
        a, b, c, d = times_s[-4:].tolist()
        if d - a > _SPAN_S or min(b - a, c - b, d - c) < _STEP_S:
            return
        weights = np.array(
            [
                1.0 / ((a - b) * (a - c) * (a - d)),
                1.0 / ((b - a) * (b - c) * (b - d)),
                1.0 / ((c - a) * (c - b) * (c - d)),
                1.0 / ((d - a) * (d - b) * (d - c)),
            ]
        )
        difference = weights @ positions_m[-4:] / np.sqrt(weights @ weights)
        size2 = float(difference @ difference)
        if size2 > 3.0 * _LARGEST_M**2:
            difference *= np.sqrt(3.0 * _LARGEST_M**2 / size2)
        gain = 1.0 / min(_MEMORY_FRAMES, self._frames)
        self._covariance_m2 += gain * (np.outer(difference, difference) - self._covariance_m2)
        self._frames += 1.0

    def covariance_m2(self) -> FloatArray:
        """The covariance, shape (3, 3); never less than 2 mm in any direction."""
        return self._covariance_m2 + _SMALLEST_M**2 * np.eye(3)
