"""Results of an identification: table, figure and neck file; and options of a camera with speed commands."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gazempc.files.documents import as_toml
from gazempc.identify.estimate import AxisEstimate
from gazempc.identify.record import IdentificationError, NeckRecord
from gazempc.identify.turning import TurnEstimate
from gazempc.live.sources.camera.capture import CameraOptions
from gazempc.neck.spec import NeckSpec
from gazempc.parts import split_address
from gazempc.results.table import aligned
from gazempc.robots.options import OnvifOptions, RobotOptions, ViscaOptions

_DETAIL_S = 4.0


def table(estimates: Sequence[AxisEstimate], neck: NeckSpec) -> str:
    """Estimates with 95 % intervals beside the values of the neck file, two joints per table.

    Args:
        estimates: One for each joint that moved.
        neck: The neck whose limits were kept.

    Returns:
        Text of several lines.
    """
    return "\n\n".join(_table(estimates[k : k + 2], neck) for k in range(0, len(estimates), 2))


def _table(estimates: Sequence[AxisEstimate], neck: NeckSpec) -> str:
    lines = [["", *(text for e in estimates for text in (f"{e.axis}, identified", f"{e.axis}, neck {neck.name}"))]]
    for label, name, factor, digits in (
        ("dead time (ms)", "dead_time_s", 1e3, 1),
        ("natural frequency (rad/s)", "natural_frequency_rad_s", 1.0, 2),
        ("damping ratio", "damping_ratio", 1.0, 3),
        ("servo lag (ms)", "servo_lag_s", 1e3, 1),
        ("bandwidth, -3 dB (Hz)", "bandwidth_hz", 1.0, 3),
    ):
        cells = [label]
        for e in estimates:
            filed = getattr(neck.axes[neck.joint_names.index(e.axis)], name, None)
            cells += [getattr(e, name).shown(factor, digits), "" if filed is None else f"{factor * filed:.{digits}f}"]
        lines.append(cells)
    for label, texts in (
        ("offset (deg)", [f"{round(math.degrees(e.offset_rad), 2) + 0.0:.2f}" for e in estimates]),
        ("fit (%)", [f"{e.fit_percent:.2f}" for e in estimates]),
        ("residual RMS (deg)", [f"{e.residual_rms_deg:.3f}" for e in estimates]),
        ("of it correlated (deg)", [f"{e.structured_rms_deg:.3f}" for e in estimates]),
        ("readings used", [f"{e.time_s.size}" + f" ({e.misread} misread)" * (e.misread > 0) for e in estimates]),
    ):
        lines.append([label, *(cell for text in texts for cell in (text, ""))])
    return "\n".join(aligned(lines))


def neck_toml(neck: NeckSpec, estimates: Sequence[AxisEstimate], name: str, origin: str, day: datetime.date) -> str:
    """A neck file with the identified values; all others from the given neck.

    Args:
        neck: Source of limits, geometry and rates.
        estimates: One for each joint that moved; a joint without an estimate is unchanged.
        name: Name of the new neck.
        origin: The measured robot or log.
        day: Date of the identification.

    Returns:
        TOML that `gazempc.neck.spec.load_neck` reads.
    """
    found = "; ".join(
        f"{e.axis}: dead time {e.dead_time_s.shown(1e3, 1)} ms, bandwidth {e.bandwidth_hz.shown(1.0, 3)} Hz, "
        f"fit {e.fit_percent:.1f} %"
        for e in estimates
    )
    kept = [axis for axis in neck.joint_names if axis not in {e.axis for e in estimates}]
    source = f"identified by gazempc on {day.isoformat()} from {origin} (95 % intervals): {found}; "
    source += "".join(f"{axis} not identified, as in {neck.name}; " for axis in kept)
    source += f"limits and geometry of {neck.name}: {neck.source}"
    servo = ("dead_time_s", "natural_frequency_rad_s", "damping_ratio")
    axes = {
        e.axis: neck.axes[neck.joint_names.index(e.axis)].model_copy(
            update={field: float(f"{getattr(e, field).value:.6g}") for field in servo}
        )
        for e in estimates
    }
    measured = neck.with_axes(axes).model_copy(update={"name": name, "source": source})
    return as_toml(measured.model_dump(exclude_none=True))


def draw(record: NeckRecord, estimates: Sequence[AxisEstimate], title: str, path: Path) -> None:
    """Draw measured against model, one column for each joint: all of it, a part of it, and the difference.

    Args:
        record: Commands and angles.
        estimates: One for each joint that moved.
        title: Title of the figure.
        path: Picture to write.
    """
    figure = Figure(figsize=(max(6.4, 5.6 * len(estimates)), 7.6), dpi=110, layout="constrained")
    columns = figure.subplots(3, len(estimates), squeeze=False, height_ratios=(3, 3, 1.6)).T
    start_s, names = float(record.command_time_s[0]), record.neck().joint_names
    for rows, e in zip(columns, estimates, strict=True):
        command_deg = np.rad2deg(record.command_rad[:, names.index(e.axis)])
        measured_deg, model_deg = np.rad2deg(e.measured_rad), np.rad2deg(e.model_rad)
        sent_s, time_s, from_s = record.command_time_s - start_s, e.time_s - start_s, _busiest_s(e) - start_s
        for ax in rows[:2]:
            ax.plot(sent_s, command_deg, label="command sent", color="0.55", lw=1.2, drawstyle="steps-post")
            ax.plot(time_s, measured_deg, label="measured", color="#E69F00", lw=3.6)
            fitted = "fitted model, from the commands alone"
            ax.plot(time_s, model_deg, label=fitted, color="#00405F", lw=1.2, ls=(0, (5, 1.5)))
            ax.set_ylabel("angle (deg)")
        rows[0].set(xlim=(0.0, time_s[-1]))
        rows[0].set_title(
            f"{e.axis}: dead time {e.dead_time_s.shown(1e3, 1)} ms\n"
            f"bandwidth {e.bandwidth_hz.shown(1.0, 2)} Hz, damping {e.damping_ratio.shown(1.0, 2)}, "
            f"fit {e.fit_percent:.1f} %",
            fontsize="medium",
        )
        rows[0].axvspan(from_s, from_s + _DETAIL_S, color="0.93", lw=0, zorder=0.5)
        rows[1].set(xlim=(from_s, from_s + _DETAIL_S), facecolor="0.97")
        rows[2].plot(time_s, measured_deg - model_deg, color="k", lw=0.7)
        rows[2].set(xlim=(0.0, time_s[-1]), xlabel="time (s)", ylabel="difference (deg)")
        for ax in rows:
            ax.grid(color="0.9", lw=0.6)
        rows[1].set_title(f"the shaded {_DETAIL_S:g} s in detail", loc="left", fontsize="small")
        rows[2].set_title(f"measured - model: RMS {e.residual_rms_deg:.3f} deg", loc="left", fontsize="small")
    handles = columns[0][0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(title, fontsize="medium")
    figure.savefig(path)


def _busiest_s(e: AxisEstimate) -> float:
    """Start of the interval with the most motion, seconds."""
    way = np.append(0.0, np.cumsum(np.abs(np.diff(e.model_rad))))
    last_s = max(float(e.time_s[-1]) - _DETAIL_S, float(e.time_s[0]))
    starts_s = e.time_s[e.time_s <= last_s]
    ways = np.interp(starts_s + _DETAIL_S, e.time_s, way) - way[: starts_s.size]
    return float(starts_s[int(np.argmax(ways))])


@dataclass(frozen=True)
class TurnedAxis:
    """One axis, identified.

    Attributes:
        name: ``pan`` or ``tilt``.
        picture: Estimate from pictures: delay from command to picture, lag and speeds.
        answers: Estimate from position feedback of the device; None if there is none.
        steps: Number of steps to each side.
    """

    name: str
    picture: TurnEstimate
    answers: TurnEstimate | None
    steps: int

    @property
    def servo(self) -> TurnEstimate:
        """The estimate of dead time, lag and speeds: from position feedback if available, which has the higher rate."""
        return self.answers or self.picture


def option_words(robot: str, options: RobotOptions, axes: Sequence[TurnedAxis]) -> list[str]:
    """Non-default options of the robot, with the measured signs, as words of the command line.

    Args:
        robot: The robot, such as ``visca:HOST``.
        options: Options of the identification run.
        axes: Pan and tilt, identified.

    Returns:
        The words; none for a user-defined robot.
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
    """Latency of the picture: its delay minus the delay of position feedback, or the stated latency, seconds."""
    known = [axis.picture.delay_s.value - axis.answers.delay_s.value for axis in axes if axis.answers is not None]
    return float(np.mean(known)) if known else 1e-3 * camera.latency_ms


def turned_table(axes: Sequence[TurnedAxis], fov_rad: float) -> str:
    """The result as text, with 95 % intervals."""
    lines = [f"lens angle {math.degrees(fov_rad):.1f} deg"]
    for axis in axes:
        picture = axis.picture
        lines.append(f"{axis.name}: delay from command to picture {picture.delay_s.shown(1e3, 1)} ms")
        if axis.answers is not None:
            lines.append(f"  of it dead time, by position feedback, {axis.answers.delay_s.shown(1e3, 1)} ms")
        servo = axis.servo
        lines += [
            f"  natural frequency {servo.natural_frequency_rad_s.shown(1.0, 1)} rad/s; sign {picture.sign:+d}",
            f"  residual {servo.residual_deg:.3f} deg",
            *(f"  step {k:+d}: {speed.shown(180.0 / math.pi, 2)} deg/s" for k, speed in servo.speeds_rad_s.items()),
        ]
    return "\n".join(lines)


def turned_toml(
    neck: NeckSpec,
    axes: Sequence[TurnedAxis],
    view_rad: tuple[float, float],
    name: str,
    origin: str,
    day: datetime.date,
) -> str:
    """A neck file with delay, servo and speed table of each axis; all else from the given neck.

    Positive speeds are to the left and up in the picture, independent of the signs of the device. Without position
    feedback the dead time contains the picture's latency.

    Args:
        neck: Source of ranges, limits and geometry.
        axes: Pan and tilt, identified.
        view_rad: Width and height of the picture, radians.
        name: Name of the new file.
        origin: Robot and picture, for its source.
        day: Date of the identification.

    Returns:
        The file as text.

    Raises:
        IdentificationError: If no speed to one side was measured.
    """
    values: dict[str, Any] = neck.model_dump(exclude_none=True)
    for axis in axes:
        ways = {"positive_rad_s": axis.picture.sign, "negative_rad_s": -axis.picture.sign}
        tables = {side: _ascending(axis, way) for side, way in ways.items()}
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
    """Speeds of the steps to one side; unmeasured steps are interpolated."""
    speeds = axis.servo.speeds_rad_s
    known = {way * step: speeds[step].value for step in sorted(speeds, key=abs) if way * step > 0}
    if not known:
        raise IdentificationError(f"{axis.name}: no picture shows the speeds to one side: more light, less blur")
    measured = np.abs(np.interp(np.arange(1, axis.steps + 1), list(known), list(known.values())))
    # Monotone: measurement noise may swap two steps of equal speed.
    return [float(f"{speed:.5g}") for speed in np.maximum.accumulate(np.maximum(measured, 1e-5))]
