"""A gaze shift to a standing person: onset, amplitude and velocity of head and eyes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gazempc.neck.kinematics import gaze_error_rad, gaze_ray
from gazempc.neck.spec import NeckSpec
from gazempc.recordings.arrays import recording_from_arrays
from gazempc.sim.replay import replay_scene
from gazempc.sim.scene import Scene
from gazempc.sim.sensor import SensorSpec
from gazempc.types import FloatArray

Direction = Literal["sideways", "up", "down"]

_DISTANCE_M = 2.5
_DURATION_S = 4.0
# A joint has begun to move at this share of its peak velocity.
_ONSET_SHARE = 0.05
# The gaze is there within this; the eye contact of a person allows 2.6 deg.
_THERE_RAD = math.radians(1.0)
# Without errors: what is looked at is the motion.
_SENSOR = SensorSpec(name="exact", source="no errors", rate_hz=30.0, latency_s=0.066)


@dataclass(frozen=True)
class Shift:
    """One shift, from straight ahead with head and eyes at rest.

    Attributes:
        direction: Where to.
        amplitude_deg: How far the gaze goes.
        times_s: Times since the person is known, shape (T,).
        head_deg: Angle of the head in the direction of the shift, shape (T,).
        eye_deg: Angle of the eyes in the head, shape (T,).
        there_s: When the gaze is on the person.
    """

    direction: Direction
    amplitude_deg: float
    times_s: FloatArray
    head_deg: FloatArray
    eye_deg: FloatArray
    there_s: float

    @property
    def head_share(self) -> float:
        """Share of the shift that the head makes in the end."""
        return float(self.head_deg[-1]) / self.amplitude_deg

    @property
    def lead_s(self) -> float:
        """Time by which the eyes begin before the head."""
        return self._onset_s(self.head_deg) - self._onset_s(self.eye_deg)

    @property
    def head_peak_deg_s(self) -> float:
        """Peak velocity of the head."""
        return float(self._speed(self.head_deg).max())

    @property
    def eye_peak_deg_s(self) -> float:
        """Peak velocity of the eyes in the head."""
        return float(self._speed(self.eye_deg).max())

    def _speed(self, angle_deg: FloatArray) -> FloatArray:
        return np.abs(np.gradient(angle_deg, self.times_s))

    def _onset_s(self, angle_deg: FloatArray) -> float:
        speed = self._speed(angle_deg)
        return float(self.times_s[np.flatnonzero(speed > _ONSET_SHARE * speed.max())[0]])


def make_shift(neck: NeckSpec, controller: str, direction: Direction, amplitude_deg: float) -> Shift:
    """Simulate a shift.

    Args:
        neck: A neck with eyes and without a body.
        controller: Name of a controller.
        direction: Where to.
        amplitude_deg: How far.

    Returns:
        The shift.
    """
    axis = 0 if direction == "sideways" else 1
    sign = -1.0 if direction == "down" else 1.0
    angle_rad = sign * math.radians(amplitude_deg)
    ahead, aside = math.cos(angle_rad), math.sin(angle_rad)
    towards = np.array([ahead, aside, 0.0] if axis == 0 else [ahead, 0.0, aside])
    eye_m, _ = gaze_ray(neck.geometry, np.zeros(neck.joints))
    times_s = np.arange(0.0, _DURATION_S, 1.0 / _SENSOR.rate_hz)
    heads_m = np.tile(eye_m + _DISTANCE_M * towards, (times_s.size, 1))
    scene = Scene(
        walk=recording_from_arrays("shift", times_s, heads_m, in_base_frame=True),
        neck=neck,
        sensor=_SENSOR,
        start_rad=(0.0, 0.0),
    )
    log = replay_scene(scene, controller, "perfect").log
    known = log.time_s >= _SENSOR.latency_s
    joints = log.joint_position_rad[known]
    since_s = log.time_s[known] - _SENSOR.latency_s
    there = gaze_error_rad(neck.geometry, joints, heads_m[0]) < _THERE_RAD
    head_deg, eye_deg = (sign * np.rad2deg(joints[:, i]) for i in (axis, 2 + axis))
    there_s = float(since_s[np.flatnonzero(there)[0]]) if there.any() else math.nan
    return Shift(direction, amplitude_deg, since_s, head_deg, eye_deg, there_s)
