"""Where the robot's head and its eyes are in the base frame: what is mounted on them moves with them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.neck.kinematics import head_angles_rad
from gazempc.neck.spec import Geometry
from gazempc.types import FloatArray


def head_in_base(geometry: Geometry, joints_rad: FloatArray) -> tuple[Rotation, FloatArray]:
    """Pose of the robot's head, whose origin is on the tilt axis.

    Args:
        geometry: The neck's geometry.
        joints_rad: Angles of all joints in the order of `NeckSpec.joint_names`, shape (N,), radians.

    Returns:
        Rotation from the head's frame to the base frame, and the origin in the base frame, shape (3,), metres.
    """
    pan_rad, tilt_rad = head_angles_rad(joints_rad)
    turn = Rotation.from_euler("z", pan_rad)
    return turn * _looking(0.0, tilt_rad), turn.apply(geometry.tilt_axis_in_pan_m)


def eye_in_base(geometry: Geometry, joints_rad: FloatArray) -> tuple[Rotation, FloatArray]:
    """Pose of the robot's eyes, which are one and turn about `Geometry.eye_in_tilt_m`.

    Args:
        geometry: The neck's geometry.
        joints_rad: As of `head_in_base`, of a neck with eyes.

    Returns:
        Rotation from the eye's frame (x along the gaze) to the base frame, and the origin, shape (3,), metres.
    """
    head, axis_m = head_in_base(geometry, joints_rad)
    return head * _looking(joints_rad[2], joints_rad[3]), axis_m + head.apply(geometry.eye_in_tilt_m)


def seen_from_head(geometry: Geometry, angles_rad: FloatArray, position_m: FloatArray) -> FloatArray:
    """A position as a sensor on the head, beside the eye, sees it.

    Args:
        geometry: The neck's geometry.
        angles_rad: Angles of all joints, shape (N,), radians.
        position_m: In the base frame, shape (3,), metres.

    Returns:
        In the head's frame: x forward, y left, z up; shape (3,), metres.
    """
    head, axis_m = head_in_base(geometry, angles_rad)
    return np.asarray(head.inv().apply(position_m - axis_m) - geometry.eye_in_tilt_m)


def _looking(pan_rad: float, tilt_rad: float) -> Rotation:
    # Tilting up turns +x towards +z, which is a negative turn about y.
    return Rotation.from_euler("z", pan_rad) * Rotation.from_euler("y", -tilt_rad)
