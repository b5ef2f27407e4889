"""Whether positions are in the unit and axes that they are read in, and where a person can be."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gazempc.live.mount import Axes, Mount
from gazempc.live.watch.frame import Finding, Frame, shown
from gazempc.live.watch.mends import Mends
from gazempc.loop.events import Event
from gazempc.types import FloatArray

_LEAST_FRAMES = 3
# Farther off, or nearer, nobody's head is tracked to look them in the eye.
_FARTHEST_M, _NEAREST_M = 20.0, 0.15
# Where people who are looked at mostly are.
_LIKELY_M, _TYPICAL_M = (0.3, 10.0), 2.0
_UNITS_M = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254, "a thousandth of metres": 1e3}
# No neck looks up or down so far for a second; in optical axes everybody is up there.
_STEEPEST_DEG, _LEVEL_DEG = 55.0, 35.0
# A robot's pan axis and the person stand on one floor.
_HIGHEST_M = 2.2
# Walking ends at 2.5 m/s; noise must not look like running.
_FASTEST_M_S, _SPEED_OVER_S = 4.0, 0.25


def judge_place(frames: Sequence[Frame], times_s: FloatArray, mount: Mount, mends: Mends) -> list[Finding]:
    """Find out whether unit, axes and motion can be a person's.

    Args:
        frames: The frames of the last second, in the order of arrival.
        times_s: Their times, of capture if these can be believed, shape (F,), seconds.
        mount: Where the sensor is.
        mends: Names what mends it.

    Returns:
        What is wrong; of a wrong unit or axes nothing that follows from it.
    """
    if len(frames) < _LEAST_FRAMES:
        return []
    sensor_m = np.array([frame.sensor_m for frame in frames])
    range_m = float(np.median(np.linalg.norm(sensor_m, axis=1)))
    if not _NEAREST_M <= range_m <= _FARTHEST_M:
        return [_of_unit(range_m, mount, mends)]
    turned_m = mount.turn.apply(sensor_m)
    elevation_deg = float(np.median(np.degrees(np.arctan2(turned_m[:, 2], np.hypot(turned_m[:, 0], turned_m[:, 1])))))
    middle_m = np.median(turned_m, axis=0)
    if abs(elevation_deg) > _STEEPEST_DEG or (abs(middle_m[2]) > _HIGHEST_M and _named_axes(middle_m)):
        return [_of_axes(middle_m, elevation_deg, mends)]
    text = [*_height(frames, mends), *_speed(frames, times_s, sensor_m, mends)]
    return [Finding(Event.IMPLAUSIBLE_PERSON, each) for each in text]


def _of_unit(range_m: float, mount: Mount, mends: Mends) -> Finding:
    low_m, high_m = _LIKELY_M
    fitting = {unit: size for unit, size in _UNITS_M.items() if low_m <= range_m * size <= high_m}
    likeliest = sorted(fitting, key=lambda unit: abs(math.log(range_m * fitting[unit] / _TYPICAL_M)))
    if not likeliest:
        where = f"{shown(range_m)} m from the sensor"
        return Finding(Event.IMPLAUSIBLE_PERSON, f"the head is {where}: check what the tracker sends as a position")
    looks = " or else ".join(
        f"{unit} ({mends.setting('mount', 'unit_m', float(f'{mount.unit_m * fitting[unit]:g}'))})" for unit in likeliest
    )
    return Finding(Event.WRONG_UNIT, f"the head is {shown(range_m)} m from the sensor: looks like {looks}")


def _of_axes(turned_m: FloatArray, elevation_deg: float, mends: Mends) -> Finding:
    said = f"the head is {abs(elevation_deg):.0f} deg {'above' if elevation_deg > 0 else 'below'} the sensor's x axis"
    axes = _named_axes(turned_m)
    named = mends.setting("mount", "axes", axes or "NAME")
    if axes == "optical":
        looks = f"looks like a camera's optical axes, x right, y down, z forward ({named})"
        # Which way y points is not told by a head straight ahead.
        looks += f"; where y points up {mends.setting('mount', 'axes', 'unity')}"
    elif axes == "opengl":
        looks = f"looks like OpenGL's axes, x right, y up, z backward ({named})"
    else:
        looks = f"check the tracker's axes ({named}) and how the sensor is turned"
    return Finding(Event.WRONG_AXES, f"{said}: {looks}")


def _named_axes(turned_m: FloatArray) -> Axes | None:
    """The axes in which the head would be about level, if those of its forward axis taken for up are such."""
    x_m, y_m, z_m = turned_m
    if z_m > 0 and _is_level(z_m, -x_m, -y_m):
        return "optical"
    return "opengl" if z_m < 0 and _is_level(-z_m, -x_m, y_m) else None


def _is_level(x_m: float, y_m: float, z_m: float) -> bool:
    return abs(math.degrees(math.atan2(z_m, math.hypot(x_m, y_m)))) < _LEVEL_DEG


def _height(frames: Sequence[Frame], mends: Mends) -> list[str]:
    heights_m = [float(frame.base_m[2]) for frame in frames if frame.base_m is not None]
    height_m = float(np.median(heights_m)) if heights_m else 0.0
    if abs(height_m) <= _HIGHEST_M:
        return []
    where = f"{abs(height_m):.1f} m {'above' if height_m > 0 else 'below'} the robot's pan axis"
    place = mends.setting("mount", "position_m", "X Y Z")
    return [f"the head is {where}: check {place} and {mends.setting('mount', 'roll_pitch_yaw_deg', 'R P Y')}"]


def _speed(frames: Sequence[Frame], times_s: FloatArray, sensor_m: FloatArray, mends: Mends) -> list[str]:
    """Of the person who is named most often: others are elsewhere."""
    names = [frame.person_id for frame in frames]
    chosen = np.array([name == max(set(names), key=names.count) for name in names])
    if len(set(names)) > chosen.sum():
        chosen[:] = True  # names that change from frame to frame name nobody
    times_s, heads_m = times_s[chosen], sensor_m[chosen]
    later = np.searchsorted(times_s, times_s + _SPEED_OVER_S)
    first = np.flatnonzero(later < times_s.size)
    if first.size < _LEAST_FRAMES:
        return []
    moved_m = np.linalg.norm(heads_m[later[first]] - heads_m[first], axis=1)
    speed_m_s = float(np.median(moved_m / (times_s[later[first]] - times_s[first])))
    if speed_m_s <= _FASTEST_M_S:
        return []
    return [
        f"the head moves at {speed_m_s:.1f} m/s: looks like several people under one name (send person_id), or a wrong "
        f"unit ({mends.setting('mount', 'unit_m', 'METRES')})"
    ]
