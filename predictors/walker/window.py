"""The last 1.2 s of a track, resampled to a uniform grid."""

from __future__ import annotations

import math

import numpy as np

from predictors.geometry import wrap_rad, yaw_rad
from predictors.types import FloatArray, HeadObservation
from predictors.walker.path import information_of, smooth_path

STEP_S = 1.0 / 30.0
# Slightly longer than a stride (two steps, about 1 s): full periods of sway and bob.
WINDOW = 36
LAGS_S = STEP_S * np.arange(1 - WINDOW, 1)
_FIRST_LAG_S = float(LAGS_S[0])
_ROUNDING_S = 1e-6
# Tolerance, in grid steps, when the track's length is rounded to whole nodes.
_NEARLY = 0.03
# Initial rows of the arrays: several windows at 30 frames a second.
_ROWS = 256


class TrackWindow:
    """Frames of the last 1.2 s.

    Attributes:
        times_s: Times of the frames, shape (N,), seconds.
        values: x, y, z, pelvis yaw, head yaw, shape (N, 5); unwrapped yaws, held while none is measured.
        yaw_seen_s: Capture times of the newest yaw of pelvis and head.
    """

    def __init__(self) -> None:
        # Time, values and information of each frame; older frames are kept until the arrays are full.
        self._arrays = np.empty(_ROWS), np.empty((_ROWS, 5)), np.empty((_ROWS, 9))
        self._rows = slice(0, 0)
        self.yaw_seen_s = [-np.inf, -np.inf]
        self._update_views()

    def _update_views(self) -> None:
        self.times_s, self.values, self._information = [array[self._rows] for array in self._arrays]

    def add(self, observation: HeadObservation, covariance_m2: FloatArray) -> list[bool]:
        """Append an observation.

        Args:
            observation: The observation, newer than all before it.
            covariance_m2: Covariance of its position, shape (3, 3).

        Returns:
            Whether it has a yaw of the pelvis and of the head.
        """
        time_s = observation.capture_time_s
        yaws_rad = self.values[-1, 3:].tolist() if len(self.values) else [0.0, 0.0]
        fresh = [False, False]
        for i, quat in enumerate((observation.pelvis_quat_wxyz, observation.head_quat_wxyz)):
            if quat is not None:
                yaws_rad[i] += wrap_rad(yaw_rad(quat) - yaws_rad[i])
                self._interpolate_gap(3 + i, self.yaw_seen_s[i], yaws_rad[i], time_s)
                self.yaw_seen_s[i] = time_s
                fresh[i] = True
        first = self._rows.start + int(self.times_s.searchsorted(time_s + _FIRST_LAG_S - _ROUNDING_S))
        end = self._rows.stop
        if end == len(self._arrays[0]):
            first, end = self._reallocate(slice(first, end))
        times_s, values, information = self._arrays
        times_s[end] = time_s
        values[end] = (*observation.head_position_base_m.tolist(), *yaws_rad)
        information[end] = information_of(covariance_m2)
        self._rows = slice(first, end + 1)
        self._update_views()
        return fresh

    def _reallocate(self, rows: slice) -> tuple[int, int]:
        # New arrays: views of the old ones may still be in use.
        count = rows.stop - rows.start
        arrays = [np.empty((max(_ROWS, 2 * count), *array.shape[1:])) for array in self._arrays]
        for array, old in zip(arrays, self._arrays, strict=True):
            array[:count] = old[rows]
        self._arrays = arrays[0], arrays[1], arrays[2]
        return 0, count

    def _interpolate_gap(self, column: int, seen_s: float, value: float, time_s: float) -> None:
        # Replaces the held yaw of a gap by linear interpolation once a new yaw is measured.
        if not self.times_s.size or self.times_s[-1] <= seen_s:
            return
        missing = self.times_s > seen_s
        if seen_s == -np.inf:
            self.values[:, column] = value
        else:
            held = self.values[missing, column]
            self.values[missing, column] += (self.times_s[missing] - seen_s) / (time_s - seen_s) * (value - held)

    def on_grid(self) -> tuple[FloatArray, FloatArray]:
        """Resample the track at 1/30 s back from the newest frame.

        Returns:
            Smoothed path, shape (m, 3), metres, and linear interpolation of `values`, shape (m, 5); 1 <= m <= WINDOW,
            newest last.
        """
        times, values = self.times_s, self.values
        now_s = float(times[-1])
        m = min(WINDOW, 1 + math.ceil((now_s - float(times[0])) / STEP_S - _NEARLY))
        if m == 1:
            return values[-1:, :3], values[-1:]
        grid = now_s + LAGS_S[WINDOW - m :]
        right = np.minimum(np.maximum(times.searchsorted(grid), 1), times.size - 1)
        left = right - 1
        begin_s, low = times[left], values[left]
        share = np.maximum((grid - begin_s) / (times[right] - begin_s), 0.0)
        resampled = low + share[:, None] * (values[right] - low)
        at = np.maximum((times - now_s) / STEP_S + (m - 1), 0.0)
        return smooth_path(at, values[:, :3], self._information, m, STEP_S), resampled
