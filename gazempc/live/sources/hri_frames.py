"""Heads in the tree of frames: which frames are people's, and where each is once all frames on its way are known."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.live.sources.hri_ids import KINDS, Kind
from gazempc.live.sources.tf import WAITS_S
from gazempc.recordings.readers.bag import is_person
from gazempc.recordings.readers.bag_frames import Poses, forward
from gazempc.ros2.transforms import Moved, Transforms
from gazempc.ros2.wire import WireError, on_loop_clock
from gazempc.types import FloatArray

_KIND = re.compile(rf"({'|'.join(KINDS)})_(\w+)")
# From the middle of the hips to between the eyes, along the back, of somebody 1.7 m tall: 0.936 and 0.530 of the height
# (Drillis & Contini, Body segment parameters, 1966).
_HEAD_OVER_HIPS_M = 0.69
# More wait only if frames on their way are missing.
_WAITING_MAX = 256


@dataclass(frozen=True)
class HeadInFrame:
    """Somebody's head.

    Attributes:
        kind: The frame that shows it.
        part_id: The tracker's name of face or body.
        captured_s: When it was there, on the loop's clock, seconds.
        position_m: Where, shape (3,), metres.
        quat_wxyz: Orientation of the frame, shape (4,); a body's is that of the pelvis.
    """

    kind: Kind
    part_id: str
    captured_s: float
    position_m: FloatArray
    quat_wxyz: FloatArray


class _Waiting(NamedTuple):
    """A head whose place may not be known yet: its frame, when it was there, and until when that is waited for."""

    name: str
    time_s: float
    captured_s: float
    until_s: float


class HeadFrames:
    """Finds heads.

    Args:
        transforms: The tree.
        is_tracked: Whether a face or body, by the tracker's name, is somebody who is tracked.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        base_frame: Frame that heads are given in. Without it that of the sensor, with optical axes turned to x forward;
            then all heads must be in one frame.
    """

    def __init__(
        self,
        transforms: Transforms,
        is_tracked: Callable[[Kind, str], bool],
        to_loop_s: Callable[[float], float],
        base_frame: str | None,
    ) -> None:
        self._transforms, self._is_tracked = transforms, is_tracked
        self._to_loop_s, self._base_frame = to_loop_s, base_frame
        self._sensor_frame: str | None = None
        self._waiting: deque[_Waiting] = deque(maxlen=_WAITING_MAX)

    def heads(self, moved: Iterable[Moved], now_s: float) -> tuple[list[HeadInFrame], list[str]]:
        """Where heads are.

        Args:
            moved: Frames that have moved.
            now_s: The time, on the loop's clock, seconds.

        Returns:
            Each head whose place is known by now, in the order of news; and for those whose place did not become known
            in time, why not.
        """
        problems: list[str] = []
        for frame, time_s in moved:
            for name in filter(self._is_head, self._transforms.moved_with(frame)):
                try:
                    captured_s = on_loop_clock(time_s, self._to_loop_s, now_s)
                except WireError as error:
                    problems.append(f"{name}: {error}")
                else:
                    self._waiting.append(_Waiting(name, time_s, captured_s, now_s + WAITS_S))
        found: list[tuple[_Waiting, FloatArray]] = []
        for _ in range(len(self._waiting)):
            head = self._waiting.popleft()
            try:
                found.append((head, self._transforms.pose(head.name, self._seen_from(head.name), head.time_s)))
            except WireError as error:
                if now_s < head.until_s:
                    self._waiting.append(head)
                else:
                    problems.append(f"{head.name}: {error}")
        return self._in_frame(found) if found else [], problems

    def _is_head(self, name: str) -> bool:
        if not _KIND.fullmatch(name) or not is_person(name):
            return False
        kind, part_id = _kind_and_id(name)
        # Of a skeleton with a head the hips are of no use.
        counts = kind != "body" or not self._transforms.knows(f"head_{part_id}")
        return counts and self._is_tracked(kind, part_id)

    def _seen_from(self, name: str) -> str:
        if self._base_frame is not None:
            return self._base_frame
        own = f"_{name.partition('_')[2]}"
        above = (up for up in self._transforms.ancestors(name) if not (is_person(up) or up.endswith(own)))
        sensor = next(above, None)
        if sensor is None:
            raise WireError("nobody tells where it is in the frame of a sensor")
        if self._sensor_frame not in (None, sensor):
            raise WireError(
                f"it is seen from {sensor!r}, others from {self._sensor_frame!r}: say --options.ros2.base-frame, a "
                "frame of the robot that tf connects with both"
            )
        self._sensor_frame = sensor
        return sensor

    def _in_frame(self, found: Sequence[tuple[_Waiting, FloatArray]]) -> list[HeadInFrame]:
        """Heads of poses, all at once: one at a time takes scipy far longer."""
        poses = np.array([pose for _, pose in found])
        position_m, quats = poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True)
        kinds_and_ids = [_kind_and_id(head.name) for head, _ in found]
        hips = np.array([kind == "body" for kind, _ in kinds_and_ids])
        position_m[hips] += _HEAD_OVER_HIPS_M * poses[hips, :3, 2]
        if self._base_frame is None and self._sensor_frame is not None:
            times_s = np.array([head.time_s for head, _ in found])
            turned, _ = forward(self._sensor_frame, Poses(times_s, np.zeros(times_s.size), position_m, quats))
            position_m, quats = turned.position_m, turned.quat_wxyz
        return [
            HeadInFrame(kind, part_id, head.captured_s, at_m, quat_wxyz)
            for (head, _), (kind, part_id), at_m, quat_wxyz in zip(found, kinds_and_ids, position_m, quats, strict=True)
        ]


def _kind_and_id(name: str) -> tuple[Kind, str]:
    kind_name, _, part_id = name.partition("_")
    return next(kind for kind in KINDS if kind == kind_name), part_id
