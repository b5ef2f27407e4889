"""humotion's neck: a time-optimal motion, planned anew at each step with limits that depend on the way left.

The target is made absolute with the encoders when the frame was *captured*. On a robot with eyes the neck moves only
for large turns of the gaze; here it has no eyes, and its target is always that of the gaze.
"""

from __future__ import annotations

import math

import numpy as np
from ruckig import InputParameter, OutputParameter, Ruckig, Synchronization

from experiments.rivals.laws.sight import bearing_rad
from experiments.rivals.rival import HeadCamera, Rival, View
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Nearer than this the limits no longer depend on the way left; it keeps them finite.
_LEAST_WAY_DEG = 0.01


def limits_for(way_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Speed and acceleration that humotion allows the neck for a way.

    Args:
        way_rad: Way to the target on each axis, shape (2,), radians.

    Returns:
        Speeds, rad/s, and accelerations, rad/s^2, shape (2,) each.
    """
    way_deg = np.maximum(np.abs(np.rad2deg(way_rad)), _LEAST_WAY_DEG)
    speed_deg_s = np.minimum(300.0, 0.3 * (4.39 * way_deg + 106.0))
    acceleration_deg_s2 = np.minimum(600.0, 0.3 * speed_deg_s**2 / way_deg)
    return np.deg2rad(speed_deg_s), np.deg2rad(acceleration_deg_s2)


class Humotion(Rival):
    """Moves to the target as fast as limits for the way allow.

    Args:
        neck: The neck; 0.8 of its range is used.
        camera: The camera on the head.
        range_share: Share of the range that is used.
        silence_s: After so long without a target it moves no more, seconds.
    """

    name = "humotion"

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, range_share: float = 0.8, silence_s: float = 1.0) -> None:
        self._camera, self._silence_s = camera, silence_s
        self._low_rad, self._high_rad = range_share * neck.position_min_rad, range_share * neck.position_max_rad
        self._planner = Ruckig(2, self.period_s)

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._position_rad = self._target_rad = view.joints.position_rad
        self._velocity_rad_s = np.zeros(2)
        self._seen_s = -math.inf

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in view.detections:
            head_rad = view.joints_at(detection.capture_time_s)
            if head_rad is not None:
                target_rad = bearing_rad(self._camera, detection.offset, head_rad)
                self._target_rad = np.clip(target_rad, self._low_rad, self._high_rad)
                self._seen_s = view.time_s
        if view.time_s - self._seen_s > self._silence_s:
            self._velocity_rad_s = np.zeros(2)
        else:
            self._move()
        return self._position_rad

    def _move(self) -> None:
        speed_rad_s, acceleration_rad_s2 = limits_for(self._target_rad - self._position_rad)
        wanted, moved = InputParameter(2), OutputParameter(2)
        wanted.synchronization = Synchronization.No
        wanted.current_position = self._position_rad.tolist()
        wanted.current_velocity = self._velocity_rad_s.tolist()
        wanted.target_position = self._target_rad.tolist()
        wanted.max_velocity, wanted.max_acceleration = speed_rad_s.tolist(), acceleration_rad_s2.tolist()
        self._planner.reset()
        self._planner.update(wanted, moved)
        self._position_rad, self._velocity_rad_s = np.array(moved.new_position), np.array(moved.new_velocity)
