"""Poses of Reachy Mini's head from joint angles and back, and the reach of the head."""

from __future__ import annotations

import numpy as np

from gazempc.neck.kinematics import pan_tilt_rad
from gazempc.types import FloatArray

# Reach of the head without the body: the daemon's inverse kinematics (reachy-mini 1.13.0) with all motors 0.5 deg or
# more inside their limits. Beyond it a motor saturates and the head tilts sideways, or the pose is ignored. Also within
# the SDK's own limits (pitch 40 deg, yaw 65 deg from the body).
_TILT_RAD = np.deg2rad([-40.0, -36.0, -32.0, -28.0, -24.0, 31.0, 36.0, 40.0])
_PAN_MAX_RAD = np.deg2rad([38.0, 47.0, 54.0, 61.0, 65.0, 65.0, 59.0, 53.5])


def head_matrix(position_rad: FloatArray) -> FloatArray:
    """Pose of the head for pan and tilt: yaw, then pitch, no roll, origin at rest.

    Args:
        position_rad: Pan (to the left) and tilt (up), shape (2,), radians.

    Returns:
        Homogeneous matrix, shape (4, 4), in the daemon's frame (x forward, y left, z up; its pitch is positive down).
    """
    (cp, ct), (sp, st) = np.cos(position_rad), np.sin(position_rad)
    return np.array(
        [[cp * ct, -sp, -cp * st, 0.0], [sp * ct, cp, -sp * st, 0.0], [st, 0.0, ct, 0.0], [0.0, 0.0, 0.0, 1.0]]
    )


def head_angles(matrix: FloatArray) -> FloatArray:
    """Pan and tilt of the head's forward axis, at any roll; the inverse of `head_matrix`.

    Args:
        matrix: Pose of the head, shape (4, 4).

    Returns:
        Pan and tilt, shape (2,), radians.

    Raises:
        ValueError: If it is not a pose: wrong shape, not finite, not a rotation.
    """
    turn = matrix[:3, :3] if matrix.shape == (4, 4) else np.full((3, 3), np.nan)
    # With a tolerance for the noise of the daemon; negated, to refuse NaN.
    if not (np.all(np.abs(turn @ turn.T - np.eye(3)) < 0.02) and np.linalg.det(turn) > 0):
        raise ValueError("not a pose")
    return pan_tilt_rad(turn[:, 0])


def clamp_to_head(position_rad: FloatArray) -> FloatArray:
    """Clamp pan and tilt, relative to the body, to the reach of the head: tilt first, then pan for that tilt.

    Args:
        position_rad: Pan and tilt, shape (2,), radians.

    Returns:
        Pan and tilt, shape (2,), radians.
    """
    tilt = np.clip(position_rad[1], _TILT_RAD[0], _TILT_RAD[-1])
    pan_max = np.interp(tilt, _TILT_RAD, _PAN_MAX_RAD)
    return np.array([np.clip(position_rad[0], -pan_max, pan_max), tilt])
