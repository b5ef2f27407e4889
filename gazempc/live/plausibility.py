"""Plausibility checks of the tracker's data: position, speed, rate, names; each finding once a run."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Literal

import numpy as np

from gazempc.live.clock import Clock
from gazempc.live.mount import Mount
from gazempc.live.stamps import Finding, Frame, SetupHints, StampReader, judge_stamps, shown, unusable
from gazempc.loop.events import Event
from gazempc.people.tracker_faults import LOW_RATE_HZ, is_low_rate
from gazempc.settings import LoopSettings
from gazempc.types import FloatArray

_LEAST_FRAMES = 3
# Range of heads tracked for eye contact.
_FARTHEST_MEDIAN_M, _NEAREST_MEDIAN_M = 20.0, 0.15
# Likely range of people, and a typical value.
_LIKELY_M, _TYPICAL_M = (0.3, 10.0), 2.0
_UNITS_M = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254, "a thousandth of metres": 1e3}
# Elevation beyond the range of necks, as of heads in optical axes; and bound of a level direction.
_STEEPEST_DEG, _LEVEL_DEG = 55.0, 35.0
# Plausible height relative to the pan axis; robot and person are on one floor.
_HIGHEST_MEDIAN_M = 2.2
# Threshold of the median speed, above walking (2.5 m/s) plus noise; and its time base.
_FASTEST_MEDIAN_M_S, _SPEED_OVER_S = 4.0, 0.25


def judge_place(
    frames: Sequence[Frame], times_s: FloatArray, mount: Mount, hints: SetupHints, several: bool = False
) -> list[Finding]:
    """Check unit, axes and motion for plausibility.

    Args:
        frames: The frames of the last second, in order of arrival.
        times_s: Their times (capture times if plausible), shape (F,), seconds.
        mount: Mounting pose of the sensor.
        hints: Names of the settings in warnings.
        several: Whether the frames are of several people; their speed is not judged.

    Returns:
        Findings; consequences of a wrong unit or wrong axes are omitted.
    """
    if len(frames) < _LEAST_FRAMES:
        return []
    sensor_m = np.array([frame.sensor_m for frame in frames])
    range_m = float(np.median(np.linalg.norm(sensor_m, axis=1)))
    if not _NEAREST_MEDIAN_M <= range_m <= _FARTHEST_MEDIAN_M:
        return [_of_unit(range_m, mount, hints)]
    turned_m = mount.turn.apply(sensor_m)
    elevation_deg = float(np.median(np.degrees(np.arctan2(turned_m[:, 2], np.hypot(turned_m[:, 0], turned_m[:, 1])))))
    middle_m = np.median(turned_m, axis=0)
    if abs(elevation_deg) > _STEEPEST_DEG or (abs(middle_m[2]) > _HIGHEST_MEDIAN_M and _named_axes(middle_m)):
        return [_of_axes(middle_m, elevation_deg, hints)]
    text = _height(frames, hints)
    if not several:
        text += _speed(frames, times_s, sensor_m, hints)
    return [Finding(Event.IMPLAUSIBLE_PERSON, each) for each in text]


def _of_unit(range_m: float, mount: Mount, hints: SetupHints) -> Finding:
    low_m, high_m = _LIKELY_M
    fitting = {unit: size for unit, size in _UNITS_M.items() if low_m <= range_m * size <= high_m}
    likeliest = sorted(fitting, key=lambda unit: abs(math.log(range_m * fitting[unit] / _TYPICAL_M)))
    if not likeliest:
        where = f"{shown(range_m)} m from the sensor"
        return Finding(Event.IMPLAUSIBLE_PERSON, f"the head is {where}: check what the tracker sends as a position")
    looks = " or else ".join(
        f"{unit} ({hints.setting('mount', 'unit_m', float(f'{mount.unit_m * fitting[unit]:g}'))})" for unit in likeliest
    )
    return Finding(Event.WRONG_UNIT, f"the head is {shown(range_m)} m from the sensor: looks like {looks}")


def _of_axes(turned_m: FloatArray, elevation_deg: float, hints: SetupHints) -> Finding:
    place = f"the head is {abs(elevation_deg):.0f} deg {'above' if elevation_deg > 0 else 'below'} the sensor's x axis"
    axes = _named_axes(turned_m)
    looks = {
        # A head straight ahead leaves the sign of y open.
        "optical": f"looks like a camera's optical axes; where y points up {hints.setting('mount', 'axes', 'unity')}",
        "opengl": "looks like OpenGL's axes",
        None: "check the tracker's axes and how the sensor is turned",
    }[axes]
    named = hints.setting("mount", "axes", axes or "NAME")
    return Finding(Event.WRONG_AXES, f"{place}: {named}, it {looks}" if axes else f"{place}: {looks} ({named})")


def _named_axes(turned_m: FloatArray) -> Literal["optical", "opengl"] | None:
    """The axes in which the head would be about level, if their forward axis is interpreted as up."""
    x_m, y_m, z_m = turned_m
    if z_m > 0 and _is_level(z_m, -x_m, -y_m):
        return "optical"
    return "opengl" if z_m < 0 and _is_level(-z_m, -x_m, y_m) else None


def _is_level(x_m: float, y_m: float, z_m: float) -> bool:
    return abs(math.degrees(math.atan2(z_m, math.hypot(x_m, y_m)))) < _LEVEL_DEG


def _height(frames: Sequence[Frame], hints: SetupHints) -> list[str]:
    heights_m = [float(frame.base_m[2]) for frame in frames if frame.base_m is not None]
    height_m = float(np.median(heights_m)) if heights_m else 0.0
    if abs(height_m) <= _HIGHEST_MEDIAN_M:
        return []
    where = f"{abs(height_m):.1f} m {'above' if height_m > 0 else 'below'} the robot's pan axis"
    place = hints.setting("mount", "position_m", "X Y Z")
    return [f"the head is {where}: check {place} and {hints.setting('mount', 'roll_pitch_yaw_deg', 'R P Y')}"]


def _speed(frames: Sequence[Frame], times_s: FloatArray, sensor_m: FloatArray, hints: SetupHints) -> list[str]:
    """Check the speed of the person with the most frames: other people are elsewhere."""
    names = [frame.person_id for frame in frames]
    chosen = np.array([name == max(set(names), key=names.count) for name in names])
    if len(set(names)) > chosen.sum():
        chosen[:] = True  # names that change at each frame identify no person
    times_s, heads_m = times_s[chosen], sensor_m[chosen]
    later = np.searchsorted(times_s, times_s + _SPEED_OVER_S)
    first = np.flatnonzero(later < times_s.size)
    if first.size < _LEAST_FRAMES:
        return []
    moved_m = np.linalg.norm(heads_m[later[first]] - heads_m[first], axis=1)
    speed_m_s = float(np.median(moved_m / (times_s[later[first]] - times_s[first])))
    if speed_m_s <= _FASTEST_MEDIAN_M_S:
        return []
    return [
        f"the head moves at {speed_m_s:.1f} m/s: looks like several people under one name (send person_id), or a wrong "
        f"unit ({hints.setting('mount', 'unit_m', 'METRES')})"
    ]


# Least number of frames, and share of distinct names in them.
_NAMED_FRAMES, _OWN_NAME_SHARE = 6, 0.9


# Quantile of the intervals that estimates the tracker's period, as missed detections cause longer ones.
_SHORTEST_SHARE, _RARE = 0.1, 0.6


def judge_rate(times_s: FloatArray, lost_after_s: float, hints: SetupHints) -> list[Finding]:
    """Check whether the frame rate is below six a second.

    Args:
        times_s: Times of the frames (capture times if plausible), shape (F,), seconds.
        lost_after_s: Time without a frame after which the loop brakes, seconds.
        hints: Names of the settings in warnings.

    Returns:
        Findings.
    """
    if not (hints.judges_rate and is_low_rate(times_s)):
        return []
    apart_s = np.diff(np.unique(times_s))
    every_s, shortest_s = float(np.median(apart_s)), float(np.quantile(apart_s, _SHORTEST_SHARE))
    text = f"{1.0 / every_s:.1f} frames a second: below {LOW_RATE_HZ:.0f} the gaze trails a walking person; "
    if shortest_s < _RARE * every_s:
        text += f"some come {1e3 * shortest_s:.0f} ms apart, so the person is rarely detected: more light, or nearer"
    else:
        text += "its camera or its computation is slow: more pictures a second, or smaller ones"
    if every_s > lost_after_s:
        text += f"; the neck stops after each frame: {hints.setting('loop', 'lost_after_s', round(2.5 * every_s, 1))}"
    return [Finding(Event.LOW_FRAME_RATE, text)]


def judge_ids(frames: Sequence[Frame], hints: SetupHints) -> list[Finding]:
    """Check whether every frame has a different name.

    Args:
        frames: The frames of the last second.
        hints: Names of the settings in warnings.

    Returns:
        Findings.
    """
    names = [frame.person_id for frame in frames if frame.person_id is not None]
    if len(names) < _NAMED_FRAMES or len(set(names)) < _OWN_NAME_SHARE * len(names):
        return []
    text = (
        f"{len(set(names))} names of people in {len(names)} frames: looks like the number of the detection; send the "
        f"track's name as person_id, or set {'use_ids=False' if hints.python else '--no-use-ids'}"
    )
    return [Finding(Event.NEW_ID_EACH_FRAME, text)]


# Bounds of the range: a robot's own head is nearer, and no tracker detects farther faces.
_NEAREST_M, _FARTHEST_M = 0.2, 30.0
# Bound of the height relative to the pan axis: lower is below the floor, and no head is higher.
_HIGHEST_M = 3.0
# Bound of the mean speed over half a second; sprinters reach 10 m/s, people in a room 3. Shorter jumps are tolerated.
_FASTEST_M_S = 6.0
_PARTS, _PART_S = 4, 0.125
_MEMORY_S = _PARTS * _PART_S
# Maximum number of names: a tracker may send as many as frames.
_NAMES_MAX = 32


class Plausibility:
    """Plausibility of heads in the base frame, by position and speed."""

    def __init__(self) -> None:
        self._paths: dict[str | None, deque[tuple[float, FloatArray]]] = {}

    def refusal(self, capture_s: float, head_base_m: FloatArray, person_id: str | None) -> str:
        """Reason to refuse a head.

        Args:
            capture_s: Time of capture, seconds.
            head_base_m: Position, shape (3,), metres.
            person_id: The tracker's name of the person.

        Returns:
            A sentence; empty for a plausible head.
        """
        return out_of_place(head_base_m) or self._too_fast(capture_s, head_base_m, person_id)

    def _too_fast(self, capture_s: float, head_m: FloatArray, person_id: str | None) -> str:
        path = self._paths.pop(person_id, None) or deque()
        if path and capture_s <= path[-1][0]:
            self._paths[person_id] = path
            return ""  # out of order: an event of the predictor
        path.append((capture_s, head_m))
        # Slightly more than half a second is kept, so that half a second is always available.
        while len(path) > 1 and path[1][0] <= capture_s - _MEMORY_S:
            path.popleft()
        self._paths[person_id] = path
        while len(self._paths) > _NAMES_MAX:
            del self._paths[next(iter(self._paths))]
        if path[0][0] > capture_s - _MEMORY_S:
            return ""
        times_s = np.array([time_s for time_s, _ in path])
        marks = np.searchsorted(times_s, capture_s - _PART_S * np.arange(_PARTS, -1, -1), side="right") - 1
        if np.any(np.diff(marks) < 1):
            return ""  # too few frames to distinguish a jump from continuous motion
        heads_m = np.array([path[mark][1] for mark in marks])
        moved_m = heads_m[-1] - heads_m[0]
        way_m = float(np.linalg.norm(moved_m))
        if way_m == 0.0:
            return ""
        speeds_m_s = np.diff(heads_m, axis=0) @ moved_m / way_m / np.diff(times_s[marks])
        if np.all(speeds_m_s > _FASTEST_M_S):
            return f"the head flies at {np.median(speeds_m_s):.0f} m/s: people stay below {_FASTEST_M_S:.0f} m/s"
        return ""


def out_of_place(head_base_m: FloatArray) -> str:
    """Reason to refuse a position.

    Args:
        head_base_m: The position, shape (3,), metres.

    Returns:
        A sentence; empty for a plausible position.
    """
    range_m, up_m = float(np.linalg.norm(head_base_m)), float(head_base_m[2])
    if range_m < _NEAREST_M:
        return f"the head is {range_m:.2f} m from the neck's pan axis: nearer than {_NEAREST_M} m it is the robot's own"
    if not range_m <= _FARTHEST_M:
        return f"the head is {shown(range_m)} m away: at most {_FARTHEST_M:.0f} m are accepted"
    if abs(up_m) > _HIGHEST_M:
        where = "above the pan axis: no head is so high" if up_m > 0 else "below the pan axis: that is under the floor"
        return f"the head is {abs(up_m):.1f} m {where}"
    return ""


# Minimum time before findings: within a second of the first frame.
_FIRST_AFTER_S, _AGAIN_AFTER_S = 0.9, 1.0
_WINDOW_S = 1.0
# Rates are estimated over a longer time: a tracker may be slower than a frame a second.
_RATE_WINDOW_S = 4.0
_FRAMES_MAX = 1000


class Watch:
    """Keeps the frames of the last seconds and checks them.

    Args:
        clock: The loop's clock.
        reader: Reader of time stamps; None if the source provides times of the loop.
        mount: Pose, unit and axes of the sensor.
        settings: Timeouts of frames and tracks.
        hints: Names of the settings in warnings.
        several: Whether the frames are of several people.
    """

    def __init__(
        self,
        clock: Clock,
        reader: StampReader | None,
        mount: Mount,
        settings: LoopSettings,
        hints: SetupHints,
        several: bool = False,
    ) -> None:
        self._clock, self._reader, self._mount = clock, reader, mount
        self._settings, self._hints, self._several = settings, hints, several
        self._frames: deque[Frame] = deque(maxlen=_FRAMES_MAX)
        self._due_s: float | None = None
        self._reported: set[Event] = set()

    def observe(self, frame: Frame) -> None:
        """Add a frame, used or not."""
        if self._due_s is None:
            self._due_s = frame.arrival_s + _FIRST_AFTER_S
        self._frames.append(frame)

    def findings(self, now_s: float) -> list[Finding]:
        """Findings; each kind once in a run, after its minimum time.

        Args:
            now_s: The time, seconds.
        """
        if self._due_s is None or now_s < self._due_s or not self._frames:
            return []
        self._due_s = now_s + _AGAIN_AFTER_S
        while self._frames and self._frames[0].arrival_s < now_s - _RATE_WINDOW_S:
            self._frames.popleft()
        found = [each for each in self._judge(now_s) if each.event not in self._reported]
        self._reported.update(each.event for each in found)
        return found

    def _judge(self, now_s: float) -> list[Finding]:
        lately = [frame for frame in self._frames if frame.arrival_s >= now_s - _WINDOW_S]
        if not lately:
            return []
        stamps = judge_stamps(lately, self._settings.stale_after_s, self._reader, self._clock, self._hints)
        believed = stamps is None and not unusable(lately, self._settings.stale_after_s)
        return [
            *([] if stamps is None else [stamps]),
            *judge_place(lately, _times_s(lately, believed), self._mount, self._hints, self._several),
            *judge_rate(_times_s(self._frames, believed), self._settings.lost_after_s, self._hints),
            *judge_ids(lately, self._hints),
        ]


def _times_s(frames: Sequence[Frame], believed: bool) -> FloatArray:
    return np.array([frame.capture_s if believed else frame.arrival_s for frame in frames])
