"""Mounting pose of the sensor, and transformation of its observations to the base frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from gazempc.neck.kinematics import eye_in_base, head_in_base
from gazempc.neck.spec import Geometry, NeckSpec
from gazempc.settings import Settings
from gazempc.types import FloatArray
from predictors import HeadObservation

Axes = Literal["flu", "optical", "opengl", "unity"]
# Rows: the package's x forward, y left, z up, as combinations of the tracker's axes.
_AXES: dict[Axes, tuple[tuple[int, int, int], ...]] = {
    "flu": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "optical": ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),
    "opengl": ((0, 0, -1), (-1, 0, 0), (0, 1, 0)),
    "unity": ((0, 0, 1), (-1, 0, 0), (0, 1, 0)),
}
# Length of the joint history: maximum age of observations in a live loop.
_MEMORY_S = 2.0


@lru_cache(maxsize=16)  # called for each observation; its construction takes 40 µs
def _turn(roll_pitch_yaw_deg: tuple[float, float, float]) -> Rotation:
    return Rotation.from_euler("xyz", roll_pitch_yaw_deg, degrees=True)


class Mount(Settings):
    """Pose of the sensor on the robot."""

    on: Literal["base", "head", "eye"] = Field(
        default="base", description="Part that carries the sensor: the robot's base, its head, or its eyes"
    )
    position_m: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0),
        description="Position on this part: from the base's origin, the tilt axis, or the eye's centre of rotation",
    )
    roll_pitch_yaw_deg: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="About x, y, z of that frame: pitch positive looks down, yaw to the left"
    )
    unit_m: float = Field(default=1.0, gt=0, description="Metres per unit of the tracker's positions")
    axes: Axes = Field(
        default="flu",
        description="The tracker's axes: flu is x forward, y left, z up; optical x right, y down, z forward; opengl "
        "x right, y up, z backward; unity x right, y up, z forward",
    )

    @property
    def moves(self) -> bool:
        """Whether the sensor moves with the joints."""
        return self.on != "base"

    @property
    def turn(self) -> Rotation:
        """Rotation from the sensor's frame to its parent frame."""
        return _turn(self.roll_pitch_yaw_deg)

    def in_sensor(self, observation: HeadObservation) -> HeadObservation:
        """An observation in metres, x forward, y left, z up of the sensor.

        Args:
            observation: In the tracker's unit and axes. Orientations are of a head with axes of the same convention, so
                the identity faces along the sensor's view.

        Returns:
            The same in the sensor's frame.
        """
        if self.unit_m == 1.0 and self.axes == "flu":
            return observation
        to_flu = np.array(_AXES[self.axes], dtype=np.float64)

        def renamed(quat: Rotation) -> Rotation:
            # Change of basis on both sides; also valid for left-handed axes.
            return Rotation.from_matrix(to_flu @ quat.as_matrix() @ to_flu.T)

        return _changed(observation, self.unit_m * to_flu, np.zeros(3), renamed)

    def to_base(self, seen: HeadObservation, geometry: Geometry, angles_rad: FloatArray | None) -> HeadObservation:
        """Transform an observation to the base frame.

        Args:
            seen: In the sensor's frame, see `in_sensor`.
            geometry: The neck's geometry.
            angles_rad: Angles of all joints when the frame was captured, shape (N,), radians; only needed for a sensor
                that moves.

        Returns:
            The same in the base frame; standard deviations of yaw are about the vertical, and stay as they are.

        Raises:
            ValueError: If the sensor moves and the angles are None.
        """
        if not self.moves and not any(self.position_m + self.roll_pitch_yaw_deg):
            return replace(seen)  # runs the validation again, as a source may bypass it
        turn, shift_m = self.turn, np.array(self.position_m)
        if self.moves:
            if angles_rad is None:
                raise ValueError(f"the sensor moves with the {self.on}, whose angles at the capture time are unknown")
            carrier, origin_m = (eye_in_base if self.on == "eye" else head_in_base)(geometry, angles_rad)
            turn, shift_m = carrier * turn, origin_m + carrier.apply(shift_m)
        return moved(seen, turn, shift_m)


def moved(observation: HeadObservation, turn: Rotation, shift_m: FloatArray) -> HeadObservation:
    """Transform an observation to another frame.

    Args:
        observation: The observation.
        turn: Rotation from its frame to the other one.
        shift_m: Origin of its frame in the other one, shape (3,), metres.

    Returns:
        The same in the other frame.
    """
    return _changed(observation, turn.as_matrix(), shift_m, lambda quat: turn * quat)


def _changed(
    seen: HeadObservation, matrix: FloatArray, shift_m: FloatArray, turned: Callable[[Rotation], Rotation]
) -> HeadObservation:
    """Positions by a matrix and a shift, orientations by a function."""
    head, pelvis = (
        None if quat is None else turned(Rotation.from_quat(quat, scalar_first=True)).as_quat(scalar_first=True)
        for quat in (seen.head_quat_wxyz, seen.pelvis_quat_wxyz)
    )
    covariance_m2 = seen.position_covariance_m2
    return replace(
        seen,
        head_position_base_m=shift_m + matrix @ seen.head_position_base_m,
        head_quat_wxyz=head,
        pelvis_quat_wxyz=pelvis,
        position_covariance_m2=None if covariance_m2 is None else matrix @ covariance_m2 @ matrix.T,
    )


class JointHistory:
    """History of the joints over the last two seconds."""

    def __init__(self) -> None:
        self._past: deque[tuple[float, FloatArray, FloatArray]] = deque()

    def add(self, time_s: float, position_rad: FloatArray, velocity_rad_s: FloatArray) -> None:
        """Add a joint state.

        Args:
            time_s: The time, seconds; strictly increasing.
            position_rad: Angles of all joints, shape (N,), radians.
            velocity_rad_s: Their velocities, shape (N,), rad/s.
        """
        self._past.append((time_s, position_rad, velocity_rad_s))
        while self._past[0][0] < time_s - _MEMORY_S:
            self._past.popleft()

    def at(self, time_s: float) -> FloatArray | None:
        """Joint angles at a time: linear interpolation, and extrapolation after the last entry.

        Args:
            time_s: The time, seconds.

        Returns:
            Angles of all joints, shape (N,), radians; None for a time before the first entry.
        """
        if not self._past or time_s < self._past[0][0]:
            return None
        last_s, position_rad, velocity_rad_s = self._past[-1]
        if time_s >= last_s:
            return position_rad + (time_s - last_s) * velocity_rad_s
        after = next(k for k, past in enumerate(self._past) if past[0] > time_s)
        (before_s, before_rad, _), (after_s, after_rad, _) = self._past[after - 1], self._past[after]
        return before_rad + (time_s - before_s) / (after_s - before_s) * (after_rad - before_rad)


def placed(mount: Mount, neck: NeckSpec, place_m: FloatArray) -> FloatArray:
    """Transform a place from the frame of a fixed mount to the neck's base frame, shape (3,), metres."""
    seen = mount.in_sensor(HeadObservation(0.0, np.array(place_m)))
    return mount.to_base(seen, neck.geometry, None).head_position_base_m
