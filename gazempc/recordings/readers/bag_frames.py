"""Frames of a ROS 2 bag over time, and their axes."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from gazempc.recordings.readers.bag_messages import TF, TF_STATIC, BagMessage, stamp_ns
from gazempc.recordings.recording import composed
from gazempc.types import BoolArray, FloatArray, IntArray

# Largest distance in time from a message of a frame for interpolation; beyond it the pose is unknown.
_LONGEST_GAP_S = 1.0
# Frames whose origin is not a sensor, so that the line of sight is unknown.
FIXED_FRAMES = ("map", "odom", "world", "earth")
Edge = tuple[str, str]


@dataclass(frozen=True)
class Poses:
    """Poses of one object in one frame.

    Attributes:
        times_s: Stamps, shape (N,), seconds.
        delays_s: From the stamp to the message's arrival in the bag, shape (N,), seconds.
        position_m: Shape (N, 3), metres.
        quat_wxyz: Shape (N, 4), unit quaternions; NaN if unknown.
    """

    times_s: FloatArray
    delays_s: FloatArray
    position_m: FloatArray
    quat_wxyz: FloatArray

    def chosen(self, rows: BoolArray | IntArray) -> Poses:
        """Rows selected by a mask or by indices."""
        return Poses(self.times_s[rows], self.delays_s[rows], self.position_m[rows], self.quat_wxyz[rows])


class FrameTree:
    """All frames of a bag.

    Args:
        messages: Messages of the bag; other topics are ignored.

    Attributes:
        moving: Poses of a child in its parent, by (parent, child), in the order of recording, repeats included.
            Includes rows with non-finite numbers or without an orientation.
        fixed: The same for `/tf_static`, one pose each, which holds at all times.
    """

    def __init__(self, messages: Iterable[BagMessage]) -> None:
        rows: dict[Edge, list[tuple[float, ...]]] = defaultdict(list)
        self.fixed: dict[Edge, Poses] = {}
        for message in messages:
            if message.topic not in (TF, TF_STATIC):
                continue
            for transform in message.content.transforms:
                edge = transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
                p, q = transform.transform.translation, transform.transform.rotation
                pose = (p.x, p.y, p.z, q.w, q.x, q.y, q.z)
                if message.topic == TF:
                    at_ns = stamp_ns(transform.header)
                    rows[edge].append((1e-9 * at_ns, 1e-9 * (message.received_ns - at_ns), *pose))
                elif np.isfinite(pose).all() and any(pose[3:]):
                    self.fixed[edge] = poses_of([(0.0, 0.0, *pose)])
        self.moving = {edge: poses_of(values) for edge, values in rows.items()}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all frames."""
        return tuple(dict.fromkeys(name for edge in (*self.moving, *self.fixed) for name in edge))

    def way(self, start: str, goal: str) -> list[tuple[Edge, bool]] | None:
        """Shortest chain of transforms between two frames.

        Args:
            start: Name of the source frame.
            goal: Name of the target frame.

        Returns:
            Transforms, each with whether it is applied from child to parent; None if the frames are not connected.
        """
        came: dict[str, list[tuple[Edge, bool]]] = {start: []}
        reached = [start]
        for here in reached:  # grows with each frame that is found
            # Static transforms first: of two chains of equal length the one without interpolation is found.
            for edge in (*self.fixed, *self.moving):
                up = here == edge[1]
                there = edge[0] if up else edge[1]
                if here in edge and there not in came:
                    came[there] = [*came[here], (edge, up)]
                    reached.append(there)
        return came.get(goal)

    def along(self, way: Iterable[tuple[Edge, bool]], times_s: FloatArray) -> tuple[FloatArray, Rotation, BoolArray]:
        """Pose of a chain's source frame in its target frame at given times.

        Args:
            way: As returned by `way`.
            times_s: Shape (N,), seconds.

        Returns:
            Positions, shape (N, 3), metres; N rotations; and a mask of the times with all transforms known, shape (N,).
        """
        position_m, turn = np.zeros((times_s.size, 3)), Rotation.identity(times_s.size)
        known = np.ones(times_s.size, dtype=np.bool_)
        for edge, up in way:
            shift_m, step, there = self._at(edge, times_s)
            known &= there
            if up:
                position_m, turn = shift_m + step.apply(position_m), step * turn
            else:
                position_m, turn = step.inv().apply(position_m - shift_m), step.inv() * turn
        return position_m, turn, known

    def _at(self, edge: Edge, times_s: FloatArray) -> tuple[FloatArray, Rotation, BoolArray]:
        poses = self.fixed[edge] if edge in self.fixed else usable(self.moving[edge])
        poses = poses.chosen(np.isfinite(poses.quat_wxyz[:, 0]))
        if not poses.times_s.size:
            nowhere = np.zeros(times_s.size, dtype=np.bool_)
            return np.zeros((times_s.size, 3)), Rotation.identity(times_s.size), nowhere
        knots_s = poses.times_s
        inside_s = np.clip(times_s, knots_s[0], knots_s[-1])
        shift_m = np.column_stack([np.interp(inside_s, knots_s, axis_m) for axis_m in poses.position_m.T])
        after = np.clip(np.searchsorted(knots_s, times_s), 0, knots_s.size - 1)
        turns = Rotation.from_quat(poses.quat_wxyz, scalar_first=True)
        step = turns[after] if knots_s.size == 1 else Slerp(knots_s, turns)(inside_s)
        near_s = np.minimum(np.abs(times_s - knots_s[after]), np.abs(times_s - knots_s[np.maximum(after - 1, 0)]))
        return shift_m, step, (near_s <= _LONGEST_GAP_S) | (edge in self.fixed)


def usable(poses: Poses) -> Poses:
    """Poses with a finite position and a valid or unknown orientation, sorted by stamp, each stamp once."""
    unknown = np.isnan(poses.quat_wxyz).all(axis=1)
    norms = np.linalg.norm(poses.quat_wxyz, axis=1)
    oriented = np.isfinite(norms) & (norms > 0.5)
    finite = np.isfinite(poses.position_m).all(axis=1) & np.isfinite(poses.times_s)
    good = poses.chosen(finite & (oriented | unknown))
    return good.chosen(np.unique(good.times_s, return_index=True)[1])


def poses_of(rows: Sequence[Sequence[float]]) -> Poses:
    """Poses of messages.

    Args:
        rows: Per message its stamp and delay, seconds, position, metres, and quaternion w, x, y, z.

    Returns:
        The poses; if no message has a stamp, times of recording replace the stamps.
    """
    table = np.array(rows, dtype=np.float64).reshape(-1, 9)
    times_s, delays_s = table[:, 0], table[:, 1]
    if not times_s.any():
        times_s, delays_s = delays_s, np.zeros_like(delays_s)
    return Poses(times_s, delays_s, table[:, 2:5], table[:, 5:9])


Axes = Literal["optical", "forward"]

# Optical axes (x right, y down, z forward) to x forward, y left, z up.
_FROM_OPTICAL = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
# Frames to which REP 103 and REP 105 give x forward, z up.
_FORWARD = re.compile(r"base(_.*)?|.*_(link|footprint|body)")
# Cosine of 60 degrees: largest median angle between an axis of a person and a direction assigned to it.
_MIN_AXIS_COSINE = 0.5


def optical_axes(frame: str, position_m: FloatArray, wanted: Axes | None = None) -> bool:
    """Whether a frame has optical axes: x right, y down, z forward.

    Args:
        frame: Name of the frame.
        position_m: Positions of people in it, shape (N, 3), metres.
        wanted: The user's option; None: inferred from the name, else from the positions of people.

    Returns:
        True for optical axes.
    """
    if wanted is not None:
        return wanted == "optical"
    if "optical" in frame:
        return True
    if frame in FIXED_FRAMES or _FORWARD.fullmatch(frame) or not len(position_m):
        return False
    # Some cameras' frames do not follow the naming convention; people are in front of them, along z or along x.
    return bool(np.median(position_m[:, 2]) > np.median(position_m[:, 0]))


def forward(frame: str, poses: Poses, wanted: Axes | None = None) -> tuple[Poses, bool]:
    """Poses with x forward, y left, z up.

    Args:
        frame: Name of the frame of the poses.
        poses: The poses.
        wanted: The user's option for the frame's axes; None: inferred by `optical_axes`.

    Returns:
        The poses in the same frame with these axes, and whether they were rotated.
    """
    if not optical_axes(frame, poses.position_m, wanted):
        return poses, False
    quats = composed(poses.quat_wxyz, first=_FROM_OPTICAL)
    return replace(poses, position_m=_FROM_OPTICAL.apply(poses.position_m), quat_wxyz=quats), True


def person_axes(
    position_m: FloatArray, quats_wxyz: FloatArray, from_sensor: bool, is_face: bool
) -> tuple[Callable[[FloatArray], FloatArray], str]:
    """Conversion of a tracker's body axes of a person to x out of the face, z up.

    Args:
        position_m: Positions of one person in a frame with x forward and z up, shape (N, 3), metres.
        quats_wxyz: Orientations in this frame, shape (N, 4); NaN if unknown.
        from_sensor: Whether the frame's origin is the sensor, which people mostly face.
        is_face: Whether the poses are of detected faces, which are turned to the sensor.

    Returns:
        A function from orientations to orientations, NaN where the axes are undetermined; and a note, empty where the
        axes are ROS4HRI's.
    """
    known = np.isfinite(quats_wxyz).all(axis=1)
    if not known.any():
        return np.copy, "positions only"
    axes = Rotation.from_quat(quats_wxyz[known], scalar_first=True).as_matrix()
    up = np.median(axes[:, 2, :], axis=0)
    sight = -position_m[known] / np.linalg.norm(position_m[known], axis=1, keepdims=True)
    ahead = np.median(np.einsum("nik,ni->nk", axes, sight), axis=0)
    # People may walk away from a sensor, but detectors find no face from behind.
    if up[2] > _MIN_AXIS_COSINE and not (from_sensor and is_face and ahead[0] < -_MIN_AXIS_COSINE):
        return np.copy, ""
    front, top = int(np.argmax(np.abs(ahead))), int(np.argmax(np.abs(up)))
    if not from_sensor or front == top or min(abs(ahead[front]), abs(up[top])) < _MIN_AXIS_COSINE:
        note = "orientations left out: no axis points up and another to the sensor"
        return partial(np.full_like, fill_value=np.nan), note
    x, z = np.sign(ahead[front]) * np.eye(3)[front], np.sign(up[top]) * np.eye(3)[top]
    turn = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    names = [f"{'-' if axis.sum() < 0 else '+'}{'xyz'[k]}" for k, axis in ((front, x), (top, z))]
    note = f"{names[0]} is used as the axis out of the face, {names[1]} as up"
    return partial(composed, last=turn), note
