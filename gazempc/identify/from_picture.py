"""Identify a camera with speed commands by its own picture: `gazempc identify --robot visca:HOST --source camera:URL`.

Each speed of the device turns the camera for a while, to one side and back. The rotation is estimated from the picture.
Position feedback of the device, if available, determines the lens angle and separates dead time from latency.
"""

from __future__ import annotations

import datetime
import math
import threading
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.command import Progress
from gazempc.errors import SettingsError
from gazempc.files.documents import as_toml
from gazempc.files.whole import write_whole
from gazempc.identify.record import IdentificationError
from gazempc.identify.turning import Pulse, TurnEstimate, Turning, estimate_turns, lens_angle_rad, turned_rad
from gazempc.live.clock import RealClock
from gazempc.live.robots import make_robot
from gazempc.live.sources.camera.capture import LIKELY_FOV_DEG, CameraOptions, Picture, check_address, open_pictures
from gazempc.neck.spec import AXES, NeckSpec
from gazempc.neck.speed_steps import SpeedSteps
from gazempc.parts import split_address
from gazempc.robots.options import OnvifOptions, RobotOptions, ViscaOptions
from gazempc.robots.ptz_emulator import EMULATOR, picture_url
from gazempc.robots.robot import Robot
from gazempc.robots.visca_packets import SPEEDS
from gazempc.types import FloatArray

_TICK_S = 0.02
# Width of compared pictures: higher resolution takes longer and is not more accurate.
_KEY_SHARE = 0.25


@dataclass
class _Pulser:
    """Robot and pictures during the pulses; a thread takes the pictures."""

    robot: Robot
    pictures: Any
    clock: RealClock
    taken: list[tuple[float, Any]] = field(default_factory=list)
    problem: str = ""
    closing: bool = False
    _answers: list[tuple[float, FloatArray]] = field(default_factory=list)

    def work(self) -> None:
        """Take grey pictures and their stamps until closed."""
        import cv2  # noqa: PLC0415

        while not self.closing:
            found = self.pictures.read()
            if not isinstance(found, Picture):
                self.problem = "the stream has ended" if found is None else str(found)
                if found is None:
                    return
                continue
            scale = min(480 / found.rgb.shape[1], 1.0)
            grey = cv2.resize(cv2.cvtColor(found.rgb, cv2.COLOR_RGB2GRAY), None, fx=scale, fy=scale, interpolation=3)
            self.taken.append((self.clock.from_monotonic_s(found.captured_s), grey))

    def hold(self, speeds_rad_s: FloatArray, until_s: float) -> float:
        """Command speeds until a time; returns the send time."""
        sent_s = math.nan
        while True:
            now_s = self.clock.now_s()
            accepted = self.robot.send_command(speeds_rad_s)
            if math.isnan(sent_s) and np.allclose(accepted, speeds_rad_s, atol=1e-6):
                sent_s = now_s
            if (state := self.robot.read_state()) is not None:
                self._answers.append((state.time_s, state.position_rad))
            if now_s >= until_s and not math.isnan(sent_s):
                return sent_s
            if now_s > until_s + 2.0:
                raise IdentificationError(f"the device does not take {speeds_rad_s} rad/s")
            self.clock.sleep_until_s(now_s + _TICK_S)

    def pulse(
        self, axis: int, step: int, speed_rad_s: float, lasts_s: float, after_s: float
    ) -> tuple[Pulse, FloatArray, tuple[Any, ...]]:
        """Execute a pulse: angles of the device, stamps of the pictures, and the grey pictures."""
        still, moving = np.zeros(2), speed_rad_s * np.eye(2)[axis]
        self.taken.clear()
        self._answers.clear()
        self.hold(still, self.clock.now_s() + 0.3)
        on_s = self.hold(moving, self.clock.now_s() + lasts_s)
        off_s = self.hold(still, self.clock.now_s())
        self.hold(still, off_s + after_s)
        if not self.taken:
            raise IdentificationError(f"no picture was received: {self.problem or 'the stream is stalled'}")
        stamps, greys = zip(*self.taken, strict=True)
        times_s, angles_rad = np.array([t for t, _ in self._answers]), np.array([q[axis] for _, q in self._answers])
        return Pulse(step, on_s, off_s, times_s, angles_rad), np.array(stamps), greys


def identify_from_picture(
    robot: str,
    options: RobotOptions,
    source: str,
    camera: CameraOptions,
    neck: NeckSpec,
    out: Path,
    delay_max_s: float,
    progress: Progress,
) -> None:
    """Turn a camera, measure it by its picture, print the result and write the neck file.

    Args:
        robot: The robot, such as ``visca:HOST``.
        options: Its options.
        source: ``camera:`` and the address of its picture.
        camera: Options of the picture; `fov_deg` is used without position feedback.
        neck: Its neck file, with ranges and top speeds.
        out: The file to write.
        delay_max_s: Upper bound of the delay, seconds.
        progress: Progress display.

    Raises:
        GazempcError: If robot or camera fails, or the pictures are insufficient.
    """
    kind, _, address = source.partition(":")
    if kind != "camera":
        raise SettingsError(f"--source {source}: accepted: camera:URL, the picture of the camera that turns")
    check_address(address)
    if not neck.speed_joints.all():
        raise SettingsError(f'neck {neck.name!r}: accepted with --source: command = "velocity" of pan and tilt')
    clock = RealClock()
    # Speeds in the neck file, which determine the durations; ten shares of full speed for a device without a table.
    counts = SPEEDS if split_address(robot)[0] == "visca" else (10, 10)
    nominal = [a.speed_steps or SpeedSteps.equal(a.full_rad_s, n) for a, n in zip(neck.axes, counts, strict=True)]
    # Commanded are equidistant speeds up to full speed, one for each step of the device.
    plans = [SpeedSteps.equal(a.full_rad_s, len(n.positive_rad_s)) for a, n in zip(neck.axes, nominal, strict=True)]
    commanded = {
        name: axis.model_copy(update={"speed_steps": steps, "velocity_max_rad_s": axis.full_rad_s})
        for name, axis, steps in zip(AXES, neck.axes, plans, strict=True)
    }
    with closing(make_robot(robot, options, neck.with_axes(commanded), clock, neck.rest_rad, 0)) as ready:
        ready.connect()
        pictures = open_pictures(picture_url() if address == EMULATOR else address, camera)
        executor = _Pulser(ready, pictures, clock)
        threading.Thread(target=executor.work, name="pictures", daemon=True).start()
        try:
            while not executor.taken and not executor.problem:
                time.sleep(_TICK_S)
            view_rad, axes = _measured(executor, camera.fov_deg, plans, nominal, delay_max_s, progress)
        finally:
            executor.closing = True
            pictures.close()
    origin = f"robot {robot}, its picture"
    print(turned_table(axes, view_rad[0]))
    for axis in axes:
        if axis.picture.sign < 0:
            print(f"Warning: {axis.name} turns in the opposite direction: file and command have the changed sign.")
    write_whole(out, turned_toml(neck, axes, view_rad, out.stem, origin))
    # Latency of the picture: its delay minus the delay of position feedback, or the stated latency.
    known_s = [axis.picture.delay_s.value - axis.answers.delay_s.value for axis in axes if axis.answers is not None]
    latency_ms = 1e3 * float(np.mean(known_s)) if known_s else camera.latency_ms
    use = f"--camera.fov-deg {math.degrees(view_rad[0]):.1f} --camera.latency-ms {latency_ms:.0f}"
    words = f"--robot {robot} --source {source} --neck {out} {use}"
    print(f"\nWritten: {out}\nUse it: python -m gazempc.live {' '.join([words, *option_words(robot, options, axes)])}")


def _measured(
    executor: _Pulser,
    fov_deg: float | None,
    plans: Sequence[SpeedSteps],
    nominal: Sequence[SpeedSteps],
    delay_max_s: float,
    progress: Progress,
) -> tuple[tuple[float, float], list[TurnedAxis]]:
    guess_rad = math.radians(fov_deg or LIKELY_FOV_DEG)
    after_s = delay_max_s + 0.5
    # First pass: lens angle, and approximate delay of the picture.
    slow_rad_s = nominal[0].positive_rad_s
    middle = min(max(int(np.searchsorted(slow_rad_s, 0.3 * guess_rad)), 1), len(slow_rad_s))
    lasts_s = _lasts_s(slow_rad_s[middle - 1], guess_rad)
    tried = [executor.pulse(0, step, plans[0].speed_rad_s(step), lasts_s, after_s) for step in (middle, -middle)]
    fov_rad = lens_angle_rad([(pulse.angle_rad, greys[0], greys[-1]) for pulse, _, greys in tried], guess_rad)
    height, width = tried[0][2][0].shape
    turnings = [Turning(name, fov_rad, width, height) for name in AXES]
    most_rad = _KEY_SHARE * fov_rad
    seen = [replace(p, time_s=t, angle_rad=turned_rad(turnings[0], greys, most_rad)) for p, t, greys in tried]
    rough = estimate_turns(seen, delay_max_s)
    after_s = rough.delay_s.value + 4.0 / rough.natural_frequency_rad_s.value + 0.5
    found: list[TurnedAxis] = []
    for index, name in enumerate(AXES):
        view_rad = (fov_rad, fov_rad * height / width)[index]
        seen, reported = [], []
        speeds_rad_s = nominal[index].positive_rad_s
        for k, nominal_rad_s in enumerate(speeds_rad_s, start=1):
            for step in (k, -k):
                speed_rad_s, lasts_s = plans[index].speed_rad_s(step), _lasts_s(nominal_rad_s, view_rad)
                answers, stamps, greys = executor.pulse(index, step, speed_rad_s, lasts_s, after_s)
                angle_rad = turned_rad(turnings[index], greys, _KEY_SHARE * view_rad)
                seen.append(replace(answers, time_s=stamps, angle_rad=angle_rad))
                if answers.time_s.size:
                    reported.append(answers)
            progress.at((index + k / len(speeds_rad_s)) / len(plans))
        by_answers = estimate_turns(reported, delay_max_s) if reported else None
        found.append(TurnedAxis(name, estimate_turns(seen, delay_max_s), by_answers, len(speeds_rad_s)))
    return (fov_rad, 2.0 * math.atan(height / width * math.tan(0.5 * fov_rad))), found


def _lasts_s(speed_rad_s: float, view_rad: float) -> float:
    # Rotation by 0.4 of the picture; the uncertainty of send times, 10 ms, is 3 % of the shortest duration.
    return min(max(0.4 * view_rad / speed_rad_s, 0.3), 1.5)


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
    words = list[str]()
    for name, value in given.model_copy(update={"directions": signs}).model_dump(exclude_defaults=True).items():
        values = value if isinstance(value, tuple | list) else (value,)
        words += [f"--options.{kind}.{name.replace('_', '-')}", *map(str, values)]
    return words


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
    neck: NeckSpec, axes: Sequence[TurnedAxis], view_rad: tuple[float, float], name: str, origin: str
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
    today = datetime.date.today().isoformat()
    source = f"identified by gazempc on {today} from {origin}; ranges of {neck.name}: {neck.source}"
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
