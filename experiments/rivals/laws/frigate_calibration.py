"""Frigate's calibration: thirty moves from none to half the field of view, and a line through their times.

It is a law like the others, which looks at no faces: a trial runs it once on the neck, and `move_time` is the fit.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from experiments.rivals.laws.frigate import MoveTime
from experiments.rivals.rival import HeadCamera, View
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

_MOVES = 30
# What the program accepts for the line's value at 0 and for its slope, seconds.
_OFFSET_S = (0.1, 10.0)
_LARGEST_SLOPE_S = 2.0


class FrigateCalibration:
    """Pans by more and more, back after each move, and takes the times.

    Args:
        neck: The neck, whose range bounds the moves.
        camera: The camera on the head; moves are in halves of its width.
    """

    name = "frigate_calibration"
    command: Literal["position"] = "position"
    period_s = 0.02

    def __init__(self, neck: NeckSpec, camera: HeadCamera) -> None:
        most = float(neck.position_max_rad[0]) / camera.half_width_rad
        self._sizes = np.minimum(np.linspace(0.0, 1.0, _MOVES), most)
        self._half_width_rad = camera.half_width_rad

    def start(self, view: View) -> None:
        """See `experiments.rivals.rival.Rival.start`."""
        self._times_s: list[float] = []
        self._started_s: float | None = None
        self._goal_rad = np.zeros(2)

    @property
    def finished(self) -> bool:
        """Whether all moves have been made."""
        return len(self._times_s) == _MOVES

    def step(self, view: View) -> FloatArray:
        """See `experiments.rivals.rival.Rival.step`."""
        if self.finished or not view.idle:
            return self._goal_rad
        if self._started_s is not None:
            self._times_s.append(view.time_s - self._started_s)
            self._started_s = None
            self._goal_rad = np.zeros(2)
        else:
            self._started_s = view.time_s
            self._goal_rad = np.array([self._sizes[len(self._times_s)] * self._half_width_rad, 0.0])
        return self._goal_rad

    def move_time(self) -> MoveTime | None:
        """The line through the times by least squares; None if the program would not accept it."""
        made = len(self._times_s)
        slope_s, offset_s = np.polyfit(self._sizes[:made], self._times_s, 1)
        if not (_OFFSET_S[0] <= offset_s <= _OFFSET_S[1] and 0.0 < slope_s <= _LARGEST_SLOPE_S):
            return None
        return MoveTime(float(offset_s), float(slope_s), self._times_s[0])
