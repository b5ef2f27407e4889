"""The true head position between the frames of a recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from gazempc.recording import Recording

FloatArray = NDArray[np.float64]


class TrueHead:
    """Cubic spline through the valid frames; a straight line at the last velocity beyond them.

    Args:
        recording: The recording; positions are in its frame.
    """

    def __init__(self, recording: Recording) -> None:
        valid = recording.truth.valid
        times = recording.times_s[valid]
        self._spline = CubicSpline(times, recording.truth.head_position_m[valid], axis=0)
        self._first_s, self._last_s = float(times[0]), float(times[-1])

    def __call__(self, times_s: ArrayLike) -> FloatArray:
        """Positions at times.

        Args:
            times_s: Times, shape (H,), seconds.

        Returns:
            Positions, shape (H, 3), metres.
        """
        times = np.asarray(times_s, dtype=np.float64)
        inside = np.clip(times, self._first_s, self._last_s)
        beyond = (times - inside)[..., None]
        positions: FloatArray = self._spline(inside) + beyond * self._spline(inside, 1)
        return positions
