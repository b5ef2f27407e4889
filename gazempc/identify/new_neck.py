"""A neck file from a data sheet; missing parameters by rules of thumb, marked as assumed."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from pydantic import Field

from gazempc.errors import SettingsError
from gazempc.files.documents import as_toml
from gazempc.files.whole import write_whole
from gazempc.identify.urdf import UrdfNeck
from gazempc.neck.spec import (
    ACCELERATION_PER_SPEED_1_S,
    AXES,
    DAMPING_RATIO,
    DEAD_TIME_S,
    JERK_PER_ACCELERATION_1_S,
    NATURAL_FREQUENCY_RAD_S,
    RULES,
    SPEED_SHARE,
    NeckSpec,
)
from gazempc.settings import Settings
from gazempc.specfiles import parse_spec

_DEG = math.pi / 180.0
# Conversion factors to rad/s. Data sheets of servos state the time for 60 degrees.
_SPEEDS = {"deg/s": _DEG, "rad/s": 1.0, "rpm": 2.0 * math.pi / 60.0}
_SPEED_UNITS = f"{', '.join(_SPEEDS)} or s/60deg"
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"

Answer = TypeVar("Answer")


class DataSheet(Settings):
    """Values of a neck's data sheet; missing ones are prompted for."""

    pan_deg: tuple[float, float] | None = Field(
        default=None, description="Range of pan, degrees: right end (negative) and left end; straight ahead is 0"
    )
    tilt_deg: tuple[float, float] | None = Field(
        default=None, description="Range of tilt, degrees: lowest (negative) and highest; level is 0"
    )
    speed: str | None = Field(default=None, description=f"Top speed of pan with its unit: {_SPEED_UNITS}")
    head_view_deg: tuple[float, float] | None = Field(
        default=None,
        description="Field of view of a camera on the head, horizontal and vertical, full angles in degrees; default: "
        "no camera on the head. Never prompted for",
    )
    tilt_speed: str | None = Field(default=None, description="Top speed of tilt with its unit; default: --sheet.speed")


@dataclass(frozen=True)
class _Axis:
    low_deg: float
    high_deg: float
    speed_rad_s: float
    sheet_speed: str


def write_new_neck(path: Path, sheet: DataSheet, urdf: UrdfNeck | None) -> None:
    """Prompt for missing values, write a neck file, and print its values and the next commands.

    Args:
        path: TOML file to write; must not exist.
        sheet: Known values.
        urdf: The neck of a URDF, in place of the sheet.

    Raises:
        SettingsError: If the file exists, a value is invalid, or a prompt is not answered.
    """
    if path.exists():
        raise SettingsError(f"--new {path}: exists already; give another name, or delete it first")
    if urdf is None:
        axes = [_axis(name, sheet) for name in AXES]
    else:
        values = zip(urdf.range_deg, urdf.speed_rad_s, strict=True)
        axes = [_Axis(*range_deg, speed_rad_s, f"{speed_rad_s:g} rad/s") for range_deg, speed_rad_s in values]
    text = neck_file(path.stem, axes, sheet.head_view_deg, urdf)
    neck = parse_spec(NeckSpec, text, str(path))
    write_whole(path, text)
    for name, axis in zip(AXES, neck.axes, strict=True):
        print(
            f"{name}: {axis.position_min_deg:g} to {axis.position_max_deg:g} deg, {axis.velocity_max_rad_s:g} rad/s, "
            f"{axis.acceleration_max_rad_s2:g} rad/s^2, {axis.jerk_max_rad_s3:g} rad/s^3; dead time "
            f"{axis.dead_time_s:g} s"
        )
        range_deg = axis.position_max_deg - axis.position_min_deg
        ramp_s = axis.velocity_max_rad_s / axis.acceleration_max_rad_s2
        ramp_s += axis.acceleration_max_rad_s2 / axis.jerk_max_rad_s3
        if (way_deg := math.degrees(axis.velocity_max_rad_s * ramp_s)) > range_deg:
            print(
                f"Warning: {name}: to reach {axis.velocity_max_rad_s:g} rad/s and to stop takes {way_deg:.0f} deg by "
                f"these rules of thumb; its range is {range_deg:.0f} deg. Is it the motor's speed before the gear? At "
                f"most {math.radians(range_deg) / ramp_s:.2g} rad/s are of use"
            )
    if urdf is not None:
        print("Options of ROS 2:", *urdf.options)
    print(f"Written: {path}; assumed values are marked in it")
    print(f"Try it: python -m gazempc.run --replay subject03_R4 --neck {path}")
    print(f"Measure it: python -m gazempc.identify --robot ROBOT --neck {path} --amplitude-deg 8 --out measured.toml")


def neck_file(
    name: str, axes: Sequence[_Axis], head_view_deg: tuple[float, float] | None, urdf: UrdfNeck | None
) -> str:
    """Text of a neck file.

    Args:
        name: Name of the neck.
        axes: Pan and tilt.
        head_view_deg: Field of view of a camera on the head.
        urdf: Source of the geometry; None for zero offsets.

    Returns:
        TOML with comments.
    """
    origin, tilt_axis_m, eye_m = "data sheet", [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    about = "# assumed: both axes and the eye in one point. Measure with a ruler: x forward, y left, z up."
    if urdf is not None:
        origin, about = "URDF", f"# URDF: {' and '.join(urdf.joint_names)}."
        tilt_axis_m, eye_m = ((each.round(5) + 0.0).tolist() for each in (urdf.tilt_axis_in_pan_m, urdf.eye_in_tilt_m))
    source = (
        f"{origin}: range and top speed (gazempc identify --new, {datetime.date.today().isoformat()}). Limits of "
        "speed, acceleration and jerk, servo and dead time by rules of thumb: assumed, not measured"
    )
    lines = [
        as_toml({"name": name, "source": source}).rstrip(),
        "control_rate_hz = 50.0              # plans per second",
        "servo_rate_hz = 200.0               # commands per second; lower it if the robot takes fewer",
        *([] if head_view_deg is None else [f"head_view_deg = {list(head_view_deg)}        # data sheet"]),
        "",
        about,
        "[geometry]",
        f"tilt_axis_in_pan_m = {tilt_axis_m}",
        f"eye_in_tilt_m = {eye_m}",
    ]
    for axis_name, axis in zip(AXES, axes, strict=True):
        velocity = SPEED_SHARE * axis.speed_rad_s
        acceleration = ACCELERATION_PER_SPEED_1_S * velocity
        jerk = JERK_PER_ACCELERATION_1_S * acceleration
        lines += ["", f"[{axis_name}]"]
        for field, value, why in (
            ("position_min_deg", axis.low_deg, origin),
            ("position_max_deg", axis.high_deg, origin),
            ("velocity_max_rad_s", velocity, f"assumed: {SPEED_SHARE:g} of the top speed, {axis.sheet_speed}"),
            ("acceleration_max_rad_s2", acceleration, f"assumed: {RULES['acceleration_max_rad_s2']}"),
            ("jerk_max_rad_s3", jerk, f"assumed: {RULES['jerk_max_rad_s3']}"),
            ("natural_frequency_rad_s", NATURAL_FREQUENCY_RAD_S, "assumed, until it is measured"),
            ("damping_ratio", DAMPING_RATIO, "assumed, until it is measured"),
            ("dead_time_s", DEAD_TIME_S, "assumed, until it is measured"),
        ):
            text = f"{field} = {float(format(value, '.4g'))}"
            lines.append(f"{text:<35} # {why}")
    return "\n".join(lines) + "\n"


def _axis(name: str, sheet: DataSheet) -> _Axis:
    ends = "right and left end" if name == "pan" else "lowest and highest"
    given = getattr(sheet, f"{name}_deg")
    low, high = _answer(
        None if given is None else f"{given[0]} {given[1]}",
        f"--sheet.{name}-deg",
        f"Range of {name} in degrees, {ends}, straight ahead is 0 (such as -80 80): ",
        read_range,
    )
    own = name == "tilt" and (sheet.tilt_speed is not None or sheet.speed is None)
    text, speed_rad_s = _answer(
        sheet.tilt_speed if own else sheet.speed,
        "--sheet.tilt-speed" if own else "--sheet.speed",
        f"Top speed of {name} with its unit (such as 300 deg/s, 55 rpm or 0.16 s/60deg): ",
        lambda answer: (answer.strip(), read_speed(answer)),
    )
    return _Axis(low, high, speed_rad_s, text)


def _answer(given: str | None, option: str, question: str, read: Callable[[str], Answer]) -> Answer:
    """An option's value, or the user's input, with a new prompt after invalid input."""
    while True:
        try:
            return read(input(question) if given is None else given)
        except EOFError:
            raise SettingsError(f"no answer: give {option}, or run this command in a terminal") from None
        except ValueError as error:
            if given is not None:
                raise SettingsError(f"{option}: {error}") from None
            print(f"  {error}")


def read_range(text: str) -> tuple[float, float]:
    """Both ends of a joint's range.

    Args:
        text: Two numbers, degrees.

    Returns:
        Lower and upper end, degrees.

    Raises:
        ValueError: If the text is invalid, or the range does not contain 0.
    """
    found = re.fullmatch(rf"\s*({_NUMBER})[\s,;]+({_NUMBER})\s*(?:deg|°)?\s*", text)
    if found is None:
        raise ValueError(f"{text!r} is not a range; expected: two numbers of degrees, such as -80 80")
    low, high = sorted(float(end) for end in found.groups())
    if not low <= 0.0 <= high or low == high:
        raise ValueError(f"{text!r} does not contain 0, which is straight ahead (0 to 180 about 90 is -90 90)")
    return low, high


def read_speed(text: str) -> float:
    """A speed with its unit.

    Args:
        text: A number and deg/s, rad/s, rpm or s/60deg.

    Returns:
        Rad/s.

    Raises:
        ValueError: If the text is invalid.
    """
    found = re.fullmatch(rf"\s*({_NUMBER})\s*([a-zA-Z°/\d]+)\s*", text)
    unit = "" if found is None else found[2].lower().replace("°", "deg")
    if found is not None and float(found[1]) > 0 and unit in (*_SPEEDS, "s/60deg"):
        return float(found[1]) * _SPEEDS[unit] if unit in _SPEEDS else 60.0 * _DEG / float(found[1])
    raise ValueError(f"{text!r} is not a speed; expected: a number with its unit, {_SPEED_UNITS}")
