"""Necks of humanoids with eyes: humotion (Flobi, Floka) and iKinGazeCtrl (iCub).

humotion: the target in the base frame is made with the encoders at the *capture* of the frame. On a robot with eyes the
neck moves for large gaze shifts only; here, without eyes, its target is always that of the gaze.

iKinGazeCtrl: a filter with a triple closed-loop pole, close to minimum jerk. The face's point in space is made with the
encoders at the *arrival* of the frame. The filter's input is the difference of target and neck; its output, a velocity,
is integrated and sent as a position. The robot's neck moves for errors above 2.5 deg only; here it always moves.
"""

from __future__ import annotations

import math

import numpy as np
from ruckig import InputParameter, OutputParameter, Ruckig, Synchronization

from experiments.rivals.rival import HeadCamera, Rival, View, bearing_rad, point_base_m
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Lower bound of the remaining way, which keeps the limits finite.
_LEAST_WAY_DEG = 0.01
# Share of the neck's range that humotion uses, and the time after which it stops without a target.
_RANGE_SHARE, _SILENCE_S = 0.8, 1.0


def limits_for(way_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Limits of speed and acceleration of humotion for a remaining way.

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
    """Time-optimal motion to the target within limits for the remaining way; arguments as of `Rival`."""

    name = "humotion"

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._planner = Ruckig(2, self.period_s)
        self._position_rad = self._target_rad = view.joints.position_rad
        self._velocity_rad_s = np.zeros(2)
        self._seen_s = -math.inf

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        low_rad, high_rad = _RANGE_SHARE * self._neck.position_min_rad, _RANGE_SHARE * self._neck.position_max_rad
        for detection in view.detections:
            head_rad = view.joints_at(detection.capture_time_s)
            if head_rad is not None:
                self._target_rad = np.clip(bearing_rad(self._camera, detection.offset, head_rad), low_rad, high_rad)
                self._seen_s = view.time_s
        if view.time_s - self._seen_s > _SILENCE_S:
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


# Of the filter -a / (s^2 - c s - b), for a duration of 1 s; and the time in which the neck makes 90 % of a step.
_A, _B, _C = -150.766, -84.981, -15.967
_NECK_TIME_S = 0.75


class IKinGazeCtrl(Rival):
    """Filters the way to the target; arguments as of `Rival`."""

    name = "ikingazectrl"
    period_s = 0.01

    def __init__(self, neck: NeckSpec, camera: HeadCamera) -> None:
        import control  # noqa: PLC0415  (takes a second, for this law only)

        super().__init__(neck, camera)
        a, b, c = _A / _NECK_TIME_S**3, _B / _NECK_TIME_S**2, _C / _NECK_TIME_S
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
            self._target_rad = self._within_range(look_at_rad(self._neck.geometry, point_m))
        difference_rad = (self._target_rad - self._position_rad)[None]
        velocity_rad_s = (self._discrete.C @ self._state + self._discrete.D @ difference_rad)[0]
        self._state = self._discrete.A @ self._state + self._discrete.B @ difference_rad
        # Trapezoidal rule, as in the discretisation of the filter.
        self._position_rad = self._position_rad + 0.5 * self.period_s * (velocity_rad_s + self._velocity_rad_s)
        self._velocity_rad_s = velocity_rad_s
        return self._position_rad
