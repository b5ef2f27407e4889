"""Axes in a bag: optical ones turned to x forward, y left, z up; and which axis of a face points out of it."""

from __future__ import annotations

import re
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.recordings.readers.bag_frames import Poses
from gazempc.recordings.readers.bag_people import FIXED_FRAMES
from gazempc.types import FloatArray

Axes = Literal["optical", "forward"]

# Optical axes (x right, y down, z forward) to x forward, y left, z up.
_FROM_OPTICAL = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
# FrameTree that REP 103 and REP 105 give x forward, z up.
_FORWARD = re.compile(r"base(_.*)?|.*_(link|footprint|body)")
# A person's axis within 60 degrees of a direction in the median is meant to point there.
_POINTS = 0.5


def optical_axes(frame: str, position_m: FloatArray, wanted: Axes | None = None) -> bool:
    """Whether a frame has optical axes: x right, y down, z forward.

    Args:
        frame: Its name.
        position_m: Of people in it, shape (N, 3), metres.
        wanted: What the user says; None: told by the name, else by where people are.

    Returns:
        True if so.
    """
    if wanted is not None:
        return wanted == "optical"
    if "optical" in frame:
        return True
    if frame in FIXED_FRAMES or _FORWARD.fullmatch(frame) or not len(position_m):
        return False
    # Cameras are not always named by the convention: people are in front of them, along z or along x.
    return bool(np.median(position_m[:, 2]) > np.median(position_m[:, 0]))


def forward(frame: str, poses: Poses, wanted: Axes | None = None) -> tuple[Poses, bool]:
    """Poses with x forward, y left, z up.

    Args:
        frame: Name of the frame that they are in.
        poses: The poses.
        wanted: What the user says of the frame's axes; None: as `optical_axes` tells.

    Returns:
        The poses in the same frame with these axes, and whether they had to be turned.
    """
    if not optical_axes(frame, poses.position_m, wanted):
        return poses, False
    quats, known = poses.quat_wxyz.copy(), np.isfinite(poses.quat_wxyz).all(axis=1)
    if known.any():
        turns = _FROM_OPTICAL * Rotation.from_quat(quats[known], scalar_first=True)
        quats[known] = turns.as_quat(scalar_first=True)
    return Poses(poses.times_s, poses.delays_s, _FROM_OPTICAL.apply(poses.position_m), quats), True


def person_axes(poses: Poses, from_sensor: bool, is_face: bool) -> tuple[Rotation | None, str]:
    """The turn from the axes that a tracker gives a person to x out of the face, z up.

    Args:
        poses: In a frame with x forward, z up.
        from_sensor: Whether its origin is the sensor, to which people turn their faces more often than not.
        is_face: Whether faces alone are seen: these are turned to the sensor.

    Returns:
        The turn, to be put behind each orientation; None where no orientation is known. And a note for people, empty
        where the axes are those of ROS4HRI.
    """
    known = np.isfinite(poses.quat_wxyz).all(axis=1)
    if not known.any():
        return None, "positions only"
    axes = Rotation.from_quat(poses.quat_wxyz[known], scalar_first=True).as_matrix()
    up = np.median(axes[:, 2, :], axis=0)
    sight = -poses.position_m[known] / np.linalg.norm(poses.position_m[known], axis=1, keepdims=True)
    ahead = np.median(np.einsum("nik,ni->nk", axes, sight), axis=0)
    # People may walk away from a sensor; but no detector of faces sees one from behind.
    if up[2] > _POINTS and not (from_sensor and is_face and ahead[0] < -_POINTS):
        return Rotation.identity(), ""
    front, top = int(np.argmax(np.abs(ahead))), int(np.argmax(np.abs(up)))
    if not from_sensor or front == top or min(abs(ahead[front]), abs(up[top])) < _POINTS:
        return None, "orientations left out: no axis points up and another to the sensor"
    x, z = np.zeros(3), np.zeros(3)
    x[front], z[top] = np.sign(ahead[front]), np.sign(up[top])
    turn = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    return turn, f"{_name(front, x)} is taken for the axis out of the face, {_name(top, z)} for up"


def _name(axis: int, direction: FloatArray) -> str:
    return f"{'-' if direction[axis] < 0 else '+'}{'xyz'[axis]}"
