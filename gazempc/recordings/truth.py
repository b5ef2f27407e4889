"""The true head position between the frames of a recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from gazempc.recordings.recording import Recording
from gazempc.types import BoolArray, FloatArray, IntArray

# Longest gap in which the interpolated position is scored; longer ones are bridged but not scored.
_LONGEST_GAP_S = 0.2
# Half a servo period, in which a head moves by 4 mm at most; each frame then has a tick at any rate.
_ON_A_FRAME_S = 0.0025
_ROUNDING_S = 1e-6


def stretches(recording: Recording) -> list[IntArray]:
    """Indices of the valid frames in each interval without a gap of more than 0.2 s."""
    seen = np.flatnonzero(recording.truth.valid)
    return np.split(seen, np.flatnonzero(np.diff(recording.times_s[seen]) > _LONGEST_GAP_S) + 1)


class TrueHead:
    """Cubic spline through the head's positions in valid frames; linear extrapolation at the last velocity.

    Args:
        recording: The recording; positions are in its frame.
    """

    def __init__(self, recording: Recording) -> None:
        valid = recording.truth.valid
        self._times_s: FloatArray = recording.times_s[valid]
        self._spline = CubicSpline(self._times_s, recording.truth.head_position_m[valid], axis=0)
        self._first_s, self._last_s = map(float, self._times_s[[0, -1]])

    def known(self, times_s: ArrayLike) -> BoolArray:
        """Mask of times with a known position: within the recording, and outside of gaps of more than 0.2 s.

        Args:
            times_s: Times, shape (H,), seconds.

        Returns:
            Shape (H,).
        """
        times = np.asarray(times_s, dtype=np.float64)
        after = np.clip(np.searchsorted(self._times_s, times), 1, self._times_s.size - 1)
        gap_s = self._times_s[after] - self._times_s[after - 1]
        on_a_frame = np.minimum(self._times_s[after] - times, times - self._times_s[after - 1]) < _ON_A_FRAME_S
        inside = (times >= self._first_s - _ROUNDING_S) & (times <= self._last_s + _ROUNDING_S)
        return inside & ((gap_s <= _LONGEST_GAP_S + _ROUNDING_S) | on_a_frame)

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
