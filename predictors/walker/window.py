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


class TrackWindow:
    """Frames of the last 1.2 s.

    Attributes:
        times_s: Times of the frames, shape (N,), seconds.
        values: x, y, z, pelvis yaw, head yaw, shape (N, 5); unwrapped yaws, held while none is measured.
        yaw_seen_s: Capture times of the newest yaw of pelvis and head.
    """

    def __init__(self) -> None:
        self.times_s, self.values, self._information = np.empty(0), np.empty((0, 5)), np.empty((0, 9))
        self.yaw_seen_s = [-np.inf, -np.inf]

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
        first = int(self.times_s.searchsorted(time_s + _FIRST_LAG_S - _ROUNDING_S))
        newest = [*observation.head_position_base_m.tolist(), *yaws_rad]
        self.times_s = np.concatenate([self.times_s[first:], [time_s]])
        self.values = np.concatenate([self.values[first:], [newest]])
        self._information = np.concatenate([self._information[first:], [information_of(covariance_m2)]])
        return fresh

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
