"""ROBOTIS OP3: at each detection the goal moves by 0.6 of the error, and a minimum-jerk motion goes there.

The error is that in the image when the frame arrives. It is added to the last goal, though the head has not arrived
there, so at a high rate of detections the same error is added several times.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import BPoly

from experiments.rivals.rival import FrameRate, HeadCamera, Rival, View, left_and_up_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

_SMALL_RAD = math.radians(1.0)
_SHORTEST_S = 0.1


class Op3(Rival):
    """Adds to the goal, and goes there with minimum jerk.

    Args:
        neck: The neck, whose range bounds the goal.
        camera: The camera on the head.
        gain: Share of the error that is added to the goal.
        derivative_gain: Share of the error's change since the last detection that is added.
        speed_deg_s: Mean speed of a motion, degrees a second.
        detection_period_s: Time between two images that the detector looks at, seconds.
    """

    name = "op3"
    free = tuple({"detection_period_s": period_s} for period_s in (1.0 / 30.0, 0.1, 0.2, 0.4))
    period_s = 0.008

    def __init__(
        self,
        neck: NeckSpec,
        camera: HeadCamera,
        *,
        gain: float = 0.6,
        derivative_gain: float = 0.25,
        speed_deg_s: float = 52.5,
        detection_period_s: float = 1.0 / 30.0,
    ) -> None:
        self._camera = camera
        self._low_rad, self._high_rad = neck.position_min_rad, neck.position_max_rad
        self._gain, self._derivative_gain = gain, derivative_gain
        self._speed_rad_s = math.radians(speed_deg_s)
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
                self._go(view.time_s, self._gain * error_rad + self._derivative_gain * change_rad)
        return self._at(view.time_s)[0]

    def _go(self, now_s: float, by_rad: FloatArray) -> None:
        goal_rad = np.clip(self._goal_rad + by_rad, self._low_rad, self._high_rad)
        duration_s = max(_SHORTEST_S, float(np.abs(by_rad).max()) / self._speed_rad_s)
        # Fifth order between two states of position, velocity and acceleration has minimum jerk.
        states = [list(self._at(now_s)), [goal_rad, np.zeros(2), np.zeros(2)]]
        self._motion = BPoly.from_derivatives([0.0, duration_s], states)
        self._goal_rad, self._started_s = goal_rad, now_s

    def _at(self, now_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration of the motion at a time."""
        since_s = now_s - self._started_s
        if self._motion is None or since_s >= self._motion.x[-1]:
            return self._goal_rad, np.zeros(2), np.zeros(2)
        return self._motion(since_s), self._motion(since_s, 1), self._motion(since_s, 2)
