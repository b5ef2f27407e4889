"""The last 1.2 s of a track, resampled to an even grid."""

from __future__ import annotations

import math

import numpy as np

from predictors.geometry import wrap_rad, yaw_rad
from predictors.types import FloatArray, HeadObservation
from predictors.walker.path import information_of, smooth_path

STEP_S = 1.0 / 30.0
# Slightly more than a stride (two steps, about 1 s): full periods of sway and bob.
WINDOW = 36
LAGS_S = STEP_S * np.arange(1 - WINDOW, 1)
_FIRST_LAG_S = float(LAGS_S[0])
_ROUNDING_S = 1e-6
# Rounding of the track's length to a whole number of nodes.
_NEARLY = 0.03
# Initial rows of the arrays: several windows at 30 frames a second.
_ROWS = 256


class TrackWindow:
    """Frames of the last 1.2 s.

    Attributes:
        times_s: Times of the frames, shape (N,), seconds.
        values: x, y, z, pelvis yaw, head yaw, shape (N, 5); the yaws unwrapped, the last known one held.
        yaw_seen_s: Times of the newest yaw of the pelvis, and of the head.
    """

    def __init__(self) -> None:
        # Time, values and information of each frame; older frames stay until the rows are used up.
        self._arrays = np.empty(_ROWS), np.empty((_ROWS, 5)), np.empty((_ROWS, 9))
        self._rows = slice(0, 0)
        self.yaw_seen_s = [-np.inf, -np.inf]
        self._see()

    def _see(self) -> None:
        self.times_s, self.values, self._information = [array[self._rows] for array in self._arrays]

    def add(self, observation: HeadObservation, covariance_m2: FloatArray) -> list[bool]:
        """Take in an observation that is newer than all before it.

        Args:
            observation: The observation.
            covariance_m2: Covariance of its position, shape (3, 3).

        Returns:
            Whether it has a yaw of the pelvis, and of the head.
        """
        time_s = observation.capture_time_s
        yaws_rad = self.values[-1, 3:].tolist() if len(self.values) else [0.0, 0.0]
        fresh = [False, False]
        for i, quat in enumerate((observation.pelvis_quat_wxyz, observation.head_quat_wxyz)):
            if quat is not None:
                yaws_rad[i] += wrap_rad(yaw_rad(quat) - yaws_rad[i])
                self._bridge(3 + i, self.yaw_seen_s[i], yaws_rad[i], time_s)
                self.yaw_seen_s[i] = time_s
                fresh[i] = True
        first = self._rows.start + int(self.times_s.searchsorted(time_s + _FIRST_LAG_S - _ROUNDING_S))
        end = self._rows.stop
        if end == len(self._arrays[0]):
            first, end = self._move(slice(first, end))
        times_s, values, information = self._arrays
        times_s[end] = time_s
        values[end] = (*observation.head_position_base_m.tolist(), *yaws_rad)
        information[end] = information_of(covariance_m2)
        self._rows = slice(first, end + 1)
        self._see()
        return fresh

    def _move(self, rows: slice) -> tuple[int, int]:
        # New arrays, as views of the old ones may still be read.
        count = rows.stop - rows.start
        arrays = [np.empty((max(_ROWS, 2 * count), *array.shape[1:])) for array in self._arrays]
        for array, old in zip(arrays, self._arrays, strict=True):
            array[:count] = old[rows]
        self._arrays = arrays[0], arrays[1], arrays[2]
        return 0, count

    def _bridge(self, column: int, seen_s: float, value: float, time_s: float) -> None:
        # A missing orientation was held; its return allows interpolation over the gap.
        if not self.times_s.size or self.times_s[-1] <= seen_s:
            return
        missing = self.times_s > seen_s
        if seen_s == -np.inf:
            self.values[:, column] = value
        else:
            held = self.values[missing, column]
            self.values[missing, column] += (self.times_s[missing] - seen_s) / (time_s - seen_s) * (value - held)

    def on_grid(self) -> tuple[FloatArray, FloatArray]:
        """The track every 1/30 s back from the newest frame.

        Returns:
            The smooth path, shape (m, 3), metres, and the linear interpolation of `values`, shape (m, 5); m from 1 to
            WINDOW, the newest last.
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
        seen = low + share[:, None] * (values[right] - low)
        at = np.maximum((times - now_s) / STEP_S + (m - 1), 0.0)
        return smooth_path(at, values[:, :3], self._information, m, STEP_S), seen
