"""Necks of humanoids with eyes: humotion (Flobi, Floka) and iKinGazeCtrl (iCub).

The target is made absolute with the encoders when the frame was *captured*. On a robot with eyes the neck moves only
for large turns of the gaze; here it has no eyes, and its target is always that of the gaze.

iKinGazeCtrl: a filter whose closed loop has a triple pole and comes close to minimum jerk.

The face's point in space is made with the encoders when the frame *arrives*. The filter's input is the difference of
target and neck, its output a velocity, which is integrated and sent as a position. On the robot the eyes do the rest,
and the neck is solved anew only where it is off by more than 2.5 deg; here the neck does everything and always.
"""

from __future__ import annotations

import math

import numpy as np
from ruckig import InputParameter, OutputParameter, Ruckig, Synchronization

from experiments.rivals.rival import HeadCamera, Rival, View, bearing_rad, point_base_m
from gazempc.neck.kinematics import look_at_rad
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


# Of the filter -a / (s^2 - c s - b), for a duration of 1 s.
_A, _B, _C = -150.766, -84.981, -15.967


class IKinGazeCtrl(Rival):
    """Filters the way to the target.

    Args:
        neck: Its geometry and its range.
        camera: The camera on the head.
        neck_time_s: In which 90 % of a step are done, seconds.
    """

    name = "ikingazectrl"
    period_s = 0.01

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, neck_time_s: float = 0.75) -> None:
        import control  # noqa: PLC0415  (takes a second, and only this law needs it)

        self._neck, self._camera = neck, camera
        a, b, c = _A / neck_time_s**3, _B / neck_time_s**2, _C / neck_time_s
        continuous = control.ss([[0.0, 1.0], [b, c]], [[0.0], [-a]], [[1.0, 0.0]], [[0.0]])
        self._discrete = control.sample_system(continuous, self.period_s, method="bilinear")

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._position_rad = self._target_rad = view.joints.position_rad
        self._state = np.zeros((2, 2))
        self._velocity_rad_s = np.zeros(2)

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in view.detections:
            point_m = point_base_m(self._neck.geometry, self._camera, detection, view.joints.position_rad)
            target_rad = look_at_rad(self._neck.geometry, point_m)
            self._target_rad = np.clip(target_rad, self._neck.position_min_rad, self._neck.position_max_rad)
        difference_rad = (self._target_rad - self._position_rad)[None]
        velocity_rad_s = (self._discrete.C @ self._state + self._discrete.D @ difference_rad)[0]
        self._state = self._discrete.A @ self._state + self._discrete.B @ difference_rad
        # Trapezoids, as the filter's own discretisation.
        self._position_rad = self._position_rad + 0.5 * self.period_s * (velocity_rad_s + self._velocity_rad_s)
        self._velocity_rad_s = velocity_rad_s
        return self._position_rad
