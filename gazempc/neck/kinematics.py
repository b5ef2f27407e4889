"""Forward kinematics (joint angles to gaze ray) and inverse kinematics (target to joint angles)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from gazempc.neck.spec import Geometry
from gazempc.types import FloatArray

# Hysteresis of the turn of pan: no switches of side for a person behind the robot.
_HYSTERESIS_RAD = 0.2
# Least number of joints of a neck with eyes; numbers of joints of a neck with a body.
_WITH_EYES, _WITH_BODY = 4, (3, 5)
# Distance to the axis below which a target's direction is undefined.
_NEAREST_M = 0.1


def head_angles_rad(joints_rad: ArrayLike) -> FloatArray:
    """Direction of the head: pan plus the body's yaw, and tilt.

    Args:
        joints_rad: Angles of all joints in the order of `NeckSpec.joint_names`, shape (..., N), radians.

    Returns:
        Pan and tilt of the head in the base frame, shape (..., 2), radians.
    """
    joints = np.asarray(joints_rad, dtype=np.float64)
    head = joints[..., :2]
    if joints.shape[-1] in _WITH_BODY:
        head = head.copy()
        head[..., 0] += joints[..., -1]
    return head


def gaze_ray(geometry: Geometry, angles_rad: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Position and direction of the gaze ray.

    Args:
        geometry: The neck's geometry.
        angles_rad: Pan (positive left) and tilt (positive up), then any joints of eyes and body, in the order of
            `NeckSpec.joint_names`; shape (..., N), radians.

    Returns:
        Position of the eye in the base frame, shape (..., 3), metres; direction of the gaze, shape (..., 3), unit.
    """
    joints = np.asarray(angles_rad, dtype=np.float64)
    angles = head_angles_rad(joints)
    cp, sp = np.cos(angles[..., 0]), np.sin(angles[..., 0])
    ct, st = np.cos(angles[..., 1]), np.sin(angles[..., 1])
    tx, ty, tz = geometry.tilt_axis_in_pan_m
    ex, ey, ez = geometry.eye_in_tilt_m
    # In the frame of the pan axis; tilting up turns +x towards +z.
    x = tx + ct * ex - st * ez
    y = np.full_like(cp, ty + ey)
    z = tz + st * ex + ct * ez
    eye = np.stack([cp * x - sp * y, sp * x + cp * y, z], axis=-1)
    if joints.shape[-1] < _WITH_EYES:
        return eye, np.stack([cp * ct, sp * ct, st], axis=-1)
    forward, left, up = unit_vector(joints[..., 2], joints[..., 3])
    ahead = ct * forward - st * up
    return eye, np.stack([cp * ahead - sp * left, sp * ahead + cp * left, st * forward + ct * up], axis=-1)


def unit_vector(pan_rad: FloatArray, tilt_rad: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unit vector at a pan and a tilt: components forward, left and up, each of the same shape."""
    level = np.cos(tilt_rad)
    return np.cos(pan_rad) * level, np.sin(pan_rad) * level, np.sin(tilt_rad)


def pan_tilt_rad(direction: FloatArray) -> FloatArray:
    """Pan and tilt, in (-pi, pi], shape (..., 2), radians, of vectors of shape (..., 3)."""
    x, y, z = np.moveaxis(direction, -1, 0)
    return np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], axis=-1)


def wrapped_rad(angle_rad: FloatArray) -> FloatArray:
    """Angles wrapped to (-pi, pi], radians, of the same shape."""
    return np.asarray(np.pi - (np.pi - angle_rad) % (2.0 * np.pi))


def eye_angles_rad(geometry: Geometry, head_rad: ArrayLike, target_base_m: ArrayLike) -> FloatArray:
    """Angles of the eyes that look at a target, at given head angles.

    Args:
        geometry: The neck's geometry.
        head_rad: Pan and tilt of the head, see `head_angles_rad`, shape (..., 2), radians.
        target_base_m: Targets in the base frame, shape (..., 3), metres.

    Returns:
        Pan and tilt of the eyes, shape (..., 2), radians, in (-pi, pi].
    """
    head = np.asarray(head_rad, dtype=np.float64)
    eye, _ = gaze_ray(geometry, head)
    x, y, z = np.moveaxis(np.asarray(target_base_m, dtype=np.float64) - eye, -1, 0)
    cp, sp = np.cos(head[..., 0]), np.sin(head[..., 0])
    ct, st = np.cos(head[..., 1]), np.sin(head[..., 1])
    ahead, left = cp * x + sp * y, cp * y - sp * x
    forward, up = ct * ahead + st * z, ct * z - st * ahead
    return np.stack([np.arctan2(left, forward), np.arctan2(up, np.hypot(forward, left))], axis=-1)


def head_in_base(geometry: Geometry, joints_rad: FloatArray) -> tuple[Rotation, FloatArray]:
    """Pose of the robot's head; its origin is on the tilt axis.

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
    """Pose of the robot's eyes, modelled as one eye that rotates about `Geometry.eye_in_tilt_m`.

    Args:
        geometry: The neck's geometry.
        joints_rad: As in `head_in_base`, for a neck with eyes.

    Returns:
        Rotation from the eye's frame (x along the gaze) to the base frame, and the origin, shape (3,), metres.
    """
    head, axis_m = head_in_base(geometry, joints_rad)
    return head * _looking(joints_rad[2], joints_rad[3]), axis_m + head.apply(geometry.eye_in_tilt_m)


def seen_from_head(geometry: Geometry, angles_rad: FloatArray, position_m: FloatArray) -> FloatArray:
    """Transform a position to the frame of a sensor on the head, at the eye.

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
    # Tilting up turns +x towards +z: a negative rotation about y.
    return Rotation.from_euler("z", pan_rad) * Rotation.from_euler("y", -tilt_rad)


def look_at_rad(geometry: Geometry, target_base_m: ArrayLike) -> FloatArray:
    """Joint angles whose gaze ray passes through a target, in closed form.

    The target's lateral offset is invariant under pan, which gives the pan angle. The height of the gaze ray above the
    tilt axis is invariant under tilt, which gives the tilt angle. Of the two solutions the one facing the target is
    chosen. A target behind the robot has a pan beyond +-90 deg; joint limits are not considered.

    Args:
        geometry: The neck's geometry.
        target_base_m: Targets in the base frame, shape (..., 3), metres.

    Returns:
        Pan and tilt, shape (..., 2), radians, in (-pi, pi]; finite, but inexact for a target inside the neck.
    """
    tx, ty, tz = geometry.tilt_axis_in_pan_m
    _, ey, ez = geometry.eye_in_tilt_m
    lateral = ty + ey
    x, y, z = np.moveaxis(np.asarray(target_base_m, dtype=np.float64), -1, 0)
    ground, above = np.hypot(x, y), z - tz
    angles = np.empty((*ground.shape, 2))
    # Avoid negative zero, which would give -pi.
    pan = np.arctan2(y + 0.0, x)
    ahead = ground - tx
    if lateral:
        pan = wrapped_rad(pan - _offset_turn(lateral, ground))
        ahead = np.sqrt(np.maximum(ground**2 - lateral**2, 0.0)) - tx
    tilt = np.arctan2(above, ahead)
    if ez:
        tilt = wrapped_rad(tilt - _offset_turn(ez, np.hypot(ahead, above)))
    angles[..., 0], angles[..., 1] = pan, tilt
    return angles


def _offset_turn(offset_m: float, distance_m: FloatArray) -> FloatArray:
    # Angle between a ray at an offset from its axis and the target; a right angle for a distance below the offset.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        sine = np.where(distance_m > 0, np.clip(offset_m / distance_m, -1.0, 1.0), np.sign(offset_m))
    return np.asarray(np.arcsin(sine), dtype=np.float64)


def angle_deviations_rad(target_base_m: FloatArray, covariance_m2: FloatArray) -> tuple[float, float]:
    """Uncertainty of the direction to a target, by first-order propagation; offsets of axes and eye are neglected.

    Args:
        target_base_m: Mean of the target's position, shape (3,), metres.
        covariance_m2: Its covariance, shape (3, 3), square metres.

    Returns:
        Standard deviations of pan and tilt, radians; NaN for input that is not finite.
    """
    x, y, z = target_base_m.tolist()
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = covariance_m2.tolist()
    ground2 = max(x * x + y * y, _NEAREST_M**2)
    ground = math.sqrt(ground2)
    along = (x * x * xx + 2.0 * x * y * xy + y * y * yy) / ground2
    across = (y * y * xx - 2.0 * x * y * xy + x * x * yy) / ground2
    both = (x * xz + y * yz) / ground
    distance2 = ground2 + z * z
    rising = (ground2 * zz - 2.0 * z * ground * both + z * z * along) / distance2
    pan2, tilt2 = across / ground2, rising / distance2
    if not math.isfinite(pan2 + tilt2):
        return math.nan, math.nan
    return math.sqrt(max(pan2, 0.0)), math.sqrt(max(tilt2, 0.0))


def unwrap_pan(angles_rad: FloatArray, near_rad: float, low_rad: float, high_rad: float) -> FloatArray:
    """Unwrap a sequence of pan angles, on the turn with the least violation of the pan limits.

    The pan angle of a person who walks behind the robot jumps from +180 to -180 deg. Without the choice of the turn the
    neck would stay at its limit until the person returned the same way.

    Args:
        angles_rad: Pan and tilt over time, shape (H, 2), radians.
        near_rad: Present pan command, radians; its turn is kept unless another violates the limits clearly less.
        low_rad: Lower pan limit, radians.
        high_rad: Upper pan limit, radians.

    Returns:
        The same directions with continuous pan, shape (H, 2), radians; the argument itself if unchanged.
    """
    pan = angles_rad[:, 0]
    # Called at every plan: the methods `min` and `max` take a third longer.
    least_rad, most_rad = np.minimum.reduce(pan), np.maximum.reduce(pan)
    if abs(pan[0] - near_rad) > np.pi or most_rad - least_rad > np.pi:
        pan = np.unwrap(np.concatenate([[near_rad], pan]))[1:]
        least_rad, most_rad = pan.min(), pan.max()
    elif least_rad >= low_rad and most_rad <= high_rad:
        return angles_rad
    if least_rad >= low_rad and most_rad <= high_rad:
        return np.stack([pan, angles_rad[:, 1]], axis=-1)

    def out_of_reach_rad(turn: float) -> float:
        moved = pan + turn
        return float(np.mean(np.maximum(moved - high_rad, 0.0) + np.maximum(low_rad - moved, 0.0)))

    turns = (-2.0 * np.pi, 2.0 * np.pi)
    best = min(turns, key=out_of_reach_rad)
    if out_of_reach_rad(best) < out_of_reach_rad(0.0) - _HYSTERESIS_RAD:
        pan = pan + best
    return np.stack([pan, angles_rad[:, 1]], axis=-1)


def gaze_error_rad(geometry: Geometry, angles_rad: ArrayLike, target_base_m: ArrayLike) -> FloatArray:
    """Angle between the gaze ray and the direction from the eye to a target.

    Args:
        geometry: The neck's geometry.
        angles_rad: Angles of all joints, shape (..., N), radians.
        target_base_m: Targets, shape (..., 3), metres, base frame.

    Returns:
        Angles in [0, pi], shape (...), radians; numerically stable for very small angles.
    """
    eye, direction = gaze_ray(geometry, angles_rad)
    to_target = np.asarray(target_base_m, dtype=np.float64) - eye
    return angle_between_rad(direction, to_target)


def angle_between_rad(one: FloatArray, other: FloatArray) -> FloatArray:
    """Angle between vectors of shape (..., 3); shape (...), radians."""
    across = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.asarray(np.arctan2(across, np.sum(one * other, axis=-1)))
