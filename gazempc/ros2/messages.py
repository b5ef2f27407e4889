"""Messages of ROS 2 without imports of ROS: names, types and stamps, and the tree of frames of tf."""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from gazempc.errors import SettingsError
from gazempc.types import FloatArray

# Message types of heads.
PoseType = Literal[
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PointStamped",
    "geometry_msgs/msg/PoseArray",
    "vision_msgs/msg/Detection3DArray",
]
_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


class Ros2Error(ValueError):
    """An invalid message, or ROS 2 is unreachable; the message states the reason."""


class FrameError(Ros2Error):
    """The tree of tf lacks a frame at a time, possibly only for now."""


def topic_name(name: str) -> str:
    """The full name of a topic, with the optional leading slash.

    Raises:
        SettingsError: If the name is invalid in ROS 2.
    """
    full = "/" + name.removeprefix("/")
    if not _TOPIC.fullmatch(full):
        raise SettingsError(f"topic {name!r}: expected letters, digits and _ between slashes, such as '/head/command'")
    return full


def stamp_s(stamp: Any) -> float:
    """The time of a message's header, seconds of ROS time.

    Args:
        stamp: A ``builtin_interfaces/msg/Time``.

    Raises:
        Ros2Error: If it has no stamp.
    """
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise Ros2Error("its header has no time stamp")
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def on_loop_clock(unix_s: float, to_loop_s: Callable[[float], float], now_s: float) -> float:
    """A stamp on the loop's clock, seconds.

    Args:
        unix_s: The stamp, seconds.
        to_loop_s: Converts Unix time to the loop's clock.
        now_s: Present time on the loop's clock, seconds.

    Raises:
        Ros2Error: If the clocks cannot agree.
    """
    time_s = to_loop_s(unix_s)
    off_s = time_s - now_s
    # Above any sensor's latency, far below the offset of simulated or unset clocks.
    if not abs(off_s) <= 5.0:
        raise Ros2Error(
            f"its time stamp is {off_s:+.1f} s from this computer's clock: set both clocks by NTP; with a simulator "
            "set options.ros2.use_sim_time"
        )
    return time_s


# Translation x, y, z in metres and the unit quaternion w, x, y, z.
_Numbers = tuple[float, float, float, float, float, float, float]


def _pose_of(numbers: _Numbers) -> FloatArray:
    """The pose as a homogeneous matrix, shape (4, 4)."""
    pose = np.eye(4)
    pose[:3, 3] = numbers[:3]
    pose[:3, :3] = Rotation.from_quat(numbers[3:], scalar_first=True).as_matrix()
    return pose


def between(early: FloatArray, late: FloatArray, share: float) -> FloatArray:
    """Interpolated pose: linear in position, constant angular velocity in orientation (slerp).

    Args:
        early: First pose, shape (4, 4).
        late: Second pose.
        share: Interpolation parameter, 0 to 1.

    Returns:
        The pose, shape (4, 4).
    """
    pose: FloatArray = early + share * (late - early)
    turns = Slerp([0.0, 1.0], Rotation.from_matrix(np.stack([early[:3, :3], late[:3, :3]])))
    pose[:3, :3] = turns(share).as_matrix()
    return pose


class Transforms:
    """The tree of frames. Times are stamps of ROS time on any clock, seconds.

    Poses are homogeneous matrices, shape (4, 4), metres, which map coordinates of a frame to those of another.
    """

    def __init__(self) -> None:
        self._parent: dict[str, str] = {}
        self._fixed: dict[str, FloatArray] = {}
        # Stamps and numbers of poses, converted to matrices on demand: few of a tree at 100 Hz are used.
        self._moving: dict[str, deque[tuple[float, _Numbers]]] = {}
        self._fixed_children: dict[str, set[str]] = defaultdict(set)
        self._newest_s = -math.inf
        self._pruned_s = -math.inf

    def take(self, transforms: Sequence[Any], fixed: bool = False) -> tuple[list[tuple[str, float]], list[str]]:
        """Add the transforms of a message.

        Args:
            transforms: Each a ``geometry_msgs/msg/TransformStamped``.
            fixed: Whether they are static, from ``/tf_static``.

        Returns:
            Frames that have moved, each with its stamp; and reasons of refused transforms.
        """
        moved: list[tuple[str, float]] = []
        problems: list[str] = []
        for transform in transforms:
            child = transform.child_frame_id.lstrip("/")
            try:
                time_s = self._take(transform.header, child, transform.transform, fixed)
            except Ros2Error as error:
                problems.append(f"{child}: {error}")
            else:
                moved += [] if fixed else [(child, time_s)]
        return moved, problems

    def _take(self, header: Any, child: str, transform: Any, fixed: bool) -> float:
        parent = header.frame_id.lstrip("/")
        if not parent or not child or parent == child:
            raise Ros2Error(f"its frame is {child!r} in {parent!r}: expected two frames")
        at, turn = transform.translation, transform.rotation
        numbers = (at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z)
        # Maximum distance: of a map's origin at the equator.
        near = all(abs(value) <= 1e8 for value in numbers[:3])
        # Tolerance of the unit length, as drivers round quaternions.
        if not near or not abs(math.hypot(*numbers[3:]) - 1.0) <= 0.05:  # also refuses NaN
            raise Ros2Error("its position exceeds the size of the earth, or its quaternion is not of unit length")
        time_s = 0.0 if fixed else stamp_s(header.stamp)
        if self._parent.get(child, parent) != parent or (child in self._fixed) != fixed:
            self._forget(child)
        self._parent[child] = parent
        if fixed:
            self._fixed[child] = _pose_of(numbers)
            self._fixed_children[parent].add(child)
        else:
            self._note(child, time_s, numbers)
        return time_s

    def has(self, frame: str) -> bool:
        """Whether a transform of a frame was received."""
        return frame in self._parent

    def ancestors(self, frame: str) -> tuple[str, ...]:
        """The ancestors of a frame, its parent first.

        Args:
            frame: Its name.

        Returns:
            Their names; a frame in a cycle appears once.
        """
        found: list[str] = []
        while (parent := self._parent.get(frame)) is not None and parent not in found:
            found.append(parent)
            frame = parent
        return tuple(found)

    def moved_with(self, frame: str) -> Iterable[str]:
        """A frame, and all its static descendants.

        Args:
            frame: Its name.

        Yields:
            Their names.
        """
        waiting, been = [frame], set[str]()
        while waiting:
            here = waiting.pop()
            if here not in been:
                been.add(here)
                yield here
                waiting += self._fixed_children.get(here, ())

    def pose(self, frame: str, seen_from: str, time_s: float | None = None) -> FloatArray:
        """Pose of a frame in another at a time.

        Args:
            frame: Its name.
            seen_from: Name of the reference frame.
            time_s: Time, seconds; None for the newest common time of all frames between.

        Returns:
            The pose, shape (4, 4).

        Raises:
            FrameError: If it is unknown, possibly only for now; names the missing frame.
        """
        up, down = (frame, *self.ancestors(frame)), (seen_from, *self.ancestors(seen_from))
        common = next((name for name in up if name in down), None)
        if common is None:
            lost = seen_from if len(down) == 1 else frame
            raise FrameError(f"tf has no path from {frame!r} to {seen_from!r}: no transform of {lost!r}")
        ways = [list(way[: way.index(common)]) for way in (up, down)]
        if time_s is None:
            newest_s = [self._moving[name][-1][0] for way in ways for name in way if name in self._moving]
            time_s = min(newest_s, default=0.0)
        pose, back = (self._along(way, time_s) for way in ways)
        return np.asarray(np.linalg.solve(back, pose), dtype=np.float64) if ways[1] else pose

    def _along(self, way: Iterable[str], time_s: float) -> FloatArray:
        pose = np.eye(4)
        for name in way:
            pose = self._at(name, time_s) @ pose
        return pose

    def _at(self, child: str, time_s: float) -> FloatArray:
        """Pose of a frame in its parent."""
        if child in self._fixed:
            return self._fixed[child]
        samples = self._moving[child]
        after = bisect_left(samples, time_s, key=lambda sample: sample[0])
        if after < len(samples) and samples[after][0] == time_s:
            return _pose_of(samples[after][1])
        where = f"pose of {child!r} in {self._parent[child]!r}"
        if after == len(samples):
            raise FrameError(f"{where}: the last transform is {time_s - samples[-1][0]:.2f} s older")
        if after == 0:
            raise FrameError(f"{where}: the first transform is {samples[0][0] - time_s:.2f} s newer")
        early, late = samples[after - 1], samples[after]
        # Maximum interval for interpolation.
        if late[0] - early[0] > 1.0:
            raise FrameError(f"{where}: a gap of {late[0] - early[0]:.2f} s between transforms")
        return between(_pose_of(early[1]), _pose_of(late[1]), (time_s - early[0]) / (late[0] - early[0]))

    def _note(self, child: str, time_s: float, numbers: _Numbers) -> None:
        samples = self._moving.setdefault(child, deque())
        # Backward jump of a stamp that indicates a restart of the sender, such as a bag played in a loop.
        if samples and time_s < samples[-1][0] - 1.0:
            samples.clear()
            self._newest_s = time_s
        if samples and time_s <= samples[-1][0]:
            return
        samples.append((time_s, numbers))
        # Length of the history: observations are used within a second.
        while samples[0][0] < time_s - 5.0:
            samples.popleft()
        self._newest_s = max(self._newest_s, time_s)
        if abs(self._newest_s - self._pruned_s) > 1.0:
            self._pruned_s = self._newest_s
            # Lifetime of a frame without new transforms, such as of a person who left.
            for name in [name for name, kept in self._moving.items() if kept[-1][0] < time_s - 30.0]:
                self._forget(name)

    def _forget(self, child: str) -> None:
        self._fixed_children.get(self._parent.pop(child, ""), set()).discard(child)
        self._fixed.pop(child, None)
        self._moving.pop(child, None)
