"""The identified axes of a camera that turns: as text, as a neck file, and as options of the command line."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gazempc.identify.new_neck import as_toml
from gazempc.identify.record import IdentificationError
from gazempc.identify.turning import TurnEstimate
from gazempc.live.sources.camera.capture import CameraOptions
from gazempc.neck.spec import NeckSpec
from gazempc.parts import split_address
from gazempc.robots.options import OnvifOptions, RobotOptions, ViscaOptions


@dataclass(frozen=True)
class TurnedAxis:
    """One axis, identified.

    Attributes:
        name: ``pan`` or ``tilt``.
        picture: By the pictures: delay from command to picture, lag and speeds.
        answers: By the device's position answers; None without them.
        steps: How many steps there are to each side.
    """

    name: str
    picture: TurnEstimate
    answers: TurnEstimate | None
    steps: int

    @property
    def servo(self) -> TurnEstimate:
        """The estimate of dead time, lag and speeds: by the answers, which come more often than pictures."""
        return self.answers or self.picture


def option_words(robot: str, options: RobotOptions, axes: Sequence[TurnedAxis]) -> list[str]:
    """Options of the robot that are not the defaults, with the measured signs, as words of the command line.

    Args:
        robot: The robot, such as ``visca:HOST``.
        options: Those with which it was driven.
        axes: Pan and tilt, identified.

    Returns:
        The words; none for a robot of the user's own.
    """
    kind = split_address(robot)[0]
    given = getattr(options, kind, None)
    if not isinstance(given, ViscaOptions | OnvifOptions):
        return []
    signs = tuple(old * axis.picture.sign for old, axis in zip(given.directions, axes, strict=True))
    given, words = given.model_copy(update={"directions": signs}), list[str]()
    for name, field_info in type(given).model_fields.items():
        value = getattr(given, name)
        if value != field_info.default:
            values = value if isinstance(value, tuple | list) else (value,)
            words += [f"--options.{kind}.{name.replace('_', '-')}", *map(str, values)]
    return words


def latency_s(axes: Sequence[TurnedAxis], camera: CameraOptions) -> float:
    """Latency of the picture: its delay less that of the answers, or the stated one, seconds."""
    known = [axis.picture.delay_s.value - axis.answers.delay_s.value for axis in axes if axis.answers is not None]
    return float(np.mean(known)) if known else 1e-3 * camera.latency_ms


def table(axes: Sequence[TurnedAxis], fov_rad: float) -> str:
    """The result as text, with 95 % intervals."""
    lines = [f"lens angle {math.degrees(fov_rad):.1f} deg"]
    for axis in axes:
        picture = axis.picture
        lines.append(f"{axis.name}: delay from command to picture {picture.delay_s.shown(1e3, 1)} ms")
        if axis.answers is not None:
            lines.append(f"  of it dead time, by the position answers, {axis.answers.delay_s.shown(1e3, 1)} ms")
        servo = axis.servo
        lines += [
            f"  natural frequency {servo.natural_frequency_rad_s.shown(1.0, 1)} rad/s; sign {picture.sign:+d}",
            f"  residual {servo.residual_deg:.3f} deg",
            *(f"  step {k:+d}: {speed.shown(180.0 / math.pi, 2)} deg/s" for k, speed in servo.speeds_rad_s.items()),
        ]
    return "\n".join(lines)


def neck_toml(
    neck: NeckSpec,
    axes: Sequence[TurnedAxis],
    view_rad: tuple[float, float],
    name: str,
    origin: str,
    day: datetime.date,
) -> str:
    """A neck file with delay, servo and speed table of each axis; all else as in the given neck.

    Positive speeds are to the left and up in the picture, whatever signs the device was driven with. Without position
    answers the dead time contains the picture's latency.

    Args:
        neck: Has ranges, limits and geometry.
        axes: Pan and tilt, identified.
        view_rad: Width and height of the picture, radians.
        name: Of the new file.
        origin: Robot and picture, for its source.
        day: Of the identification.

    Returns:
        The file as text.

    Raises:
        IdentificationError: If no speed to one side was measured.
    """
    values: dict[str, Any] = neck.model_dump(exclude_none=True)
    for axis in axes:
        tables = {
            k: _ascending(axis, way * axis.picture.sign) for k, way in (("positive_rad_s", 1), ("negative_rad_s", -1))
        }
        values[axis.name] |= {
            "speed_steps": tables,
            "velocity_max_rad_s": min(speeds[-1] for speeds in tables.values()),
            "dead_time_s": float(f"{max(axis.servo.delay_s.value, 0.0):.4g}"),
            "natural_frequency_rad_s": float(f"{axis.servo.natural_frequency_rad_s.value:.4g}"),
            "damping_ratio": 1.0,
        }
        values[axis.name].pop("full_speed_rad_s", None)
    source = f"identified by gazempc on {day.isoformat()} from {origin}; ranges of {neck.name}: {neck.source}"
    view_deg = [round(math.degrees(angle_rad), 1) for angle_rad in view_rad]
    return as_toml(values | {"name": name, "source": source, "head_view_deg": view_deg})


def _ascending(axis: TurnedAxis, way: int) -> list[float]:
    """Speeds of the steps to one side; a step that was not seen lies between its neighbours."""
    speeds = axis.servo.speeds_rad_s
    known = {way * step: speeds[step].value for step in sorted(speeds, key=abs) if way * step > 0}
    if not known:
        raise IdentificationError(f"{axis.name}: no picture shows the speeds to one side: more light, less blur")
    measured = np.abs(np.interp(np.arange(1, axis.steps + 1), list(known), list(known.values())))
    # Two steps of one speed may measure in either order.
    return [float(f"{speed:.5g}") for speed in np.maximum.accumulate(np.maximum(measured, 1e-5))]
