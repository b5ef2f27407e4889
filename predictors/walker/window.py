"""The last 1.2 s of a track on an even grid, whatever the frame rate, the gaps and the error of each position."""

from __future__ import annotations

import math

import numpy as np

from predictors.types import FloatArray, HeadObservation
from predictors.walker.smoothing import information_of, smooth_path
from predictors.yaw import wrap_rad, yaw_rad

STEP_S = 1.0 / 30.0
# A little more than a stride (two steps, about 1 s): sway and bob are seen whole.
WINDOW = 36
LAGS_S = STEP_S * np.arange(1 - WINDOW, 1)
_FIRST_LAG_S = float(LAGS_S[0])
_ROUNDING_S = 1e-6
# A track that is this much of a step too short for a node has it all the same.
_NEARLY = 0.03


class TrackWindow:
    """Frames of the last 1.2 s."""

    def __init__(self) -> None:
        self.times_s = np.empty(0)
        # x, y, z, pelvis yaw, head yaw; the yaws unwrapped, the last known one held.
        self.values = np.empty((0, 5))
        self._information = np.empty((0, 9))
        self.yaw_seen_s = [-np.inf, -np.inf]

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
        old = int(self.times_s.searchsorted(time_s + _FIRST_LAG_S - _ROUNDING_S))
        row = [*observation.head_position_base_m.tolist(), *yaws_rad]
        self.times_s = np.concatenate([self.times_s[old:], [time_s]])
        self.values = np.concatenate([self.values[old:], [row]])
        self._information = np.concatenate([self._information[old:], information_of(covariance_m2)[None]])
        return fresh

    def _bridge(self, column: int, seen_s: float, value: float, time_s: float) -> None:
        # Where an orientation was missing it was held; now that it is back, the way between is known better.
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
            The smooth path, shape (m, 3), metres, and what was seen, straight between frames, shape (m, 5), as the
            columns of `values`; m from 1 to WINDOW, the newest last.
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
