"""ROBOTIS OP3: each detection moves the goal by 0.6 of the error; the head follows with minimum jerk.

The error in the image at the arrival of the frame is added to the last goal, before the head has reached it. At a high
rate of detections the same error is integrated several times.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import BPoly

from experiments.rivals.rival import FrameRate, HeadCamera, Rival, View, left_and_up_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

_GAIN, _DERIVATIVE_GAIN = 0.6, 0.25
_SPEED_RAD_S = math.radians(52.5)  # mean speed of a motion
_SMALL_RAD = math.radians(1.0)
_SHORTEST_S = 0.1


class Op3(Rival):
    """Adds to the goal, and goes there with minimum jerk.

    Args:
        neck: Model of the neck: its range bounds the goal.
        camera: Model of the camera.
        detection_period_s: Period of the detector, seconds.
    """

    name = "op3"
    free = tuple({"detection_period_s": period_s} for period_s in (1.0 / 30.0, 0.1, 0.2, 0.4))
    period_s = 0.008

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, detection_period_s: float = 1.0 / 30.0) -> None:
        super().__init__(neck, camera)
        self._detector = FrameRate(detection_period_s)

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._detector.reset()
        self._goal_rad = view.joints.position_rad
        self._error_rad: FloatArray | None = None
        self._motion: BPoly | None = None
        self._started_s = view.time_s

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in self._detector.take(view.detections):
            error_rad = left_and_up_rad(self._camera, detection.offset)
            change_rad = np.zeros(2) if self._error_rad is None else error_rad - self._error_rad
            self._error_rad = error_rad
            if (np.abs(error_rad) >= _SMALL_RAD).any():
                self._go(view.time_s, _GAIN * error_rad + _DERIVATIVE_GAIN * change_rad)
        return self._at(view.time_s)[0]

    def _go(self, now_s: float, by_rad: FloatArray) -> None:
        goal_rad = self._within_range(self._goal_rad + by_rad)
        duration_s = max(_SHORTEST_S, float(np.abs(by_rad).max()) / _SPEED_RAD_S)
        # The polynomial of fifth order between two states of position, velocity and acceleration has minimum jerk.
        states = [list(self._at(now_s)), [goal_rad, np.zeros(2), np.zeros(2)]]
        self._motion = BPoly.from_derivatives([0.0, duration_s], states)
        self._goal_rad, self._started_s = goal_rad, now_s

    def _at(self, now_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration of the motion at a time."""
        since_s = now_s - self._started_s
        if self._motion is None or since_s >= self._motion.x[-1]:
            return self._goal_rad, np.zeros(2), np.zeros(2)
        return self._motion(since_s), self._motion(since_s, 1), self._motion(since_s, 2)
