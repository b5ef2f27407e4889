"""Robots with trajectory generators: humotion (Flobi, Floka), iKinGazeCtrl (iCub), OP3, and PR2's point_head.

humotion: the target in the base frame is computed with the encoders at the *capture* of the frame. On a robot with eyes
the neck moves for large gaze shifts only; here, without eyes, its target is always the gaze's.

iKinGazeCtrl: a filter with a triple closed-loop pole, close to minimum jerk. The face's point in space is computed with
the encoders at the *arrival* of the frame. The filter's input is the difference of target and neck; its output, a
velocity, is integrated and sent as a position. The robot's neck moves for errors above 2.5 deg only; here always.

ROBOTIS OP3: the image error at the arrival of the frame is added to the last goal, before the head has reached it. At a
high detection rate the same error is integrated several times.

point_head: the goal is a point in space, computed with the head's pose at the *capture* of the frame (the goal's time
stamp). Each goal starts a two-point trajectory from the current state, which the next goal interrupts.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from ruckig import InputParameter, OutputParameter, Ruckig, Synchronization
from scipy.interpolate import BPoly

from experiments.rivals.rival import FrameRate, HeadCamera, Rival, View, bearing_rad, left_and_up_rad, point_base_m
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Lower bound of the remaining distance, which keeps the limits finite.
_LEAST_WAY_DEG = 0.01
# Share of the neck's range that humotion uses, and the time after which it stops without a target.
_RANGE_SHARE, _SILENCE_S = 0.8, 1.0


def limits_for(way_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Limits of speed and acceleration of humotion for a remaining distance.

    Args:
        way_rad: Distance to the target on each axis, shape (2,), radians.

    Returns:
        Speeds, rad/s, and accelerations, rad/s^2, shape (2,) each.
    """
    way_deg = np.maximum(np.abs(np.rad2deg(way_rad)), _LEAST_WAY_DEG)
    speed_deg_s = np.minimum(300.0, 0.3 * (4.39 * way_deg + 106.0))
    acceleration_deg_s2 = np.minimum(600.0, 0.3 * speed_deg_s**2 / way_deg)
    return np.deg2rad(speed_deg_s), np.deg2rad(acceleration_deg_s2)


class Humotion(Rival):
    """Time-optimal motion to the target with distance-dependent limits; arguments as of `Rival`."""

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


# Coefficients of the filter -a / (s^2 - c s - b) for a duration of 1 s; time of the neck to 90 % of a step.
_A, _B, _C = -150.766, -84.981, -15.967
_NECK_TIME_S = 0.75


class IKinGazeCtrl(Rival):
    """Second-order filter of the remaining distance; arguments as of `Rival`."""

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
        # Trapezoidal rule, as for the filter.
        self._position_rad = self._position_rad + 0.5 * self.period_s * (velocity_rad_s + self._velocity_rad_s)
        self._velocity_rad_s = velocity_rad_s
        return self._position_rad


class PointToPoint(Rival):
    """Base of laws with polynomial point-to-point motion; arguments as of `Rival`."""

    # Number of boundary conditions (position, velocity, ...) at each end of a motion.
    derivatives: ClassVar[int]

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._goal_rad = view.joints.position_rad
        self._motion: BPoly | None = None

    def _go(self, now_s: float, start_s: float, duration_s: float, goal_rad: FloatArray) -> None:
        """Plan a motion to rest at a goal; the current state is held until its start."""
        states = [self._at(now_s), [goal_rad, *self._rest]]
        self._motion = BPoly.from_derivatives([start_s, start_s + duration_s], states)
        self._goal_rad = goal_rad

    def _at(self, now_s: float) -> list[FloatArray]:
        """Position and derivatives of the motion at a time."""
        if self._motion is None or now_s >= self._motion.x[-1]:
            return [self._goal_rad, *self._rest]
        return [self._motion(max(now_s, self._motion.x[0]), k) for k in range(self.derivatives)]

    @property
    def _rest(self) -> list[FloatArray]:
        return [np.zeros(2)] * (self.derivatives - 1)


# OP3: gains, mean speed of a motion, and dead zone of the error.
_GAIN, _DERIVATIVE_GAIN = 0.6, 0.25
_OP3_SPEED_RAD_S, _SMALL_RAD = math.radians(52.5), math.radians(1.0)
_SHORTEST_S = 0.1


class Op3(PointToPoint):
    """PD increments of the goal, with minimum-jerk motion to it.

    Args:
        neck: Model of the neck, with the range of the goal.
        camera: Model of the camera.
        detection_period_s: Period of the detector, seconds.
    """

    name = "op3"
    derivatives = 3  # fifth-order polynomial: minimum jerk
    free = tuple({"detection_period_s": period_s} for period_s in (1.0 / 30.0, 0.1, 0.2, 0.4))
    period_s = 0.008

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, detection_period_s: float = 1.0 / 30.0) -> None:
        super().__init__(neck, camera)
        self._detection_period_s = detection_period_s

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        super().start(view)
        self._detector = FrameRate(self._detection_period_s)
        self._error_rad: FloatArray | None = None

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in self._detector.take(view.detections):
            error_rad = left_and_up_rad(self._camera, detection.offset)
            change_rad = np.zeros(2) if self._error_rad is None else error_rad - self._error_rad
            self._error_rad = error_rad
            if (np.abs(error_rad) >= _SMALL_RAD).any():
                by_rad = _GAIN * error_rad + _DERIVATIVE_GAIN * change_rad
                duration_s = max(_SHORTEST_S, float(np.abs(by_rad).max()) / _OP3_SPEED_RAD_S)
                self._go(view.time_s, view.time_s, duration_s, self._within_range(self._goal_rad + by_rad))
        return self._at(view.time_s)[0]


# PR2: delay from a goal to the start of its trajectory, and least duration.
_START_S = 0.01
# Mean speed of a motion; a parameter of the goal, with the value of the robot's tutorial.
_PR2_SPEED_RAD_S = 1.0


class Pr2PointHead(PointToPoint):
    """Sends a two-point trajectory for each detection.

    Args:
        neck: Model of the neck: geometry and range.
        camera: Model of the camera.
        min_duration_s: Least duration of a motion, seconds; a parameter of the goal, 0.5 in the robot's tutorial.
    """

    name = "pr2_point_head"
    derivatives = 2  # a cubic
    free = tuple({"min_duration_s": duration_s} for duration_s in (0.1, 0.2, 0.5, 1.0))
    period_s = 0.01

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, min_duration_s: float = 0.5) -> None:
        super().__init__(neck, camera)
        self._min_duration_s = min_duration_s

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in view.detections:
            head_rad = view.joints_at(detection.capture_time_s)
            if head_rad is not None:
                point_m = point_base_m(self._neck.geometry, self._camera, detection, head_rad)
                goal_rad = self._within_range(look_at_rad(self._neck.geometry, point_m))
                way_rad = float(np.abs(goal_rad - self._at(view.time_s)[0]).max())
                duration_s = max(_START_S, self._min_duration_s, way_rad / _PR2_SPEED_RAD_S)
                self._go(view.time_s, view.time_s + _START_S, duration_s, goal_rad)
        return self._at(view.time_s)[0]
