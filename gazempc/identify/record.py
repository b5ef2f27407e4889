"""Execution of the excitation on a robot, with a record of commands and measured angles."""

from __future__ import annotations

import contextlib
import json
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.errors import GazempcError, RobotError, SettingsError, shown
from gazempc.files.whole import write_whole
from gazempc.identify.excitation import brake
from gazempc.live.clock import Clock
from gazempc.loop.boundary import numbers
from gazempc.neck.spec import NeckSpec
from gazempc.parts import error_line
from gazempc.results.log_files import load_log, read_arrays
from gazempc.robots.robot import Robot, checked_reading
from gazempc.types import FloatArray

# Timeout of readings: without feedback the motion is stopped.
_SILENCE_S = 0.5
# Plausibility bound, also of Unix time in seconds.
_LARGEST = 1e12


class IdentificationError(GazempcError):
    """The data do not determine the result: the reason with figures, and the remedy."""


@dataclass(frozen=True)
class NeckRecord:
    """Commands and measured angles of one run, each with its own time stamps.

    Saved as an ``.npz`` file with one array per field; ``numpy.load(path)`` reads it.

    Attributes:
        about: JSON text: origin, the complete neck, and settings.
        command_time_s: Send times of the commands, shape (K,), seconds.
        command_rad: Commands, shape (K, N), radians; each is held until the next.
        joint_time_s: Measurement times, shape (M,), seconds, on the same clock.
        joint_rad: Measured angles, shape (M, N), radians.
        failed_reads: Number of failed readings.
    """

    about: str
    command_time_s: FloatArray
    command_rad: FloatArray
    joint_time_s: FloatArray
    joint_rad: FloatArray
    failed_reads: int = 0

    def neck(self) -> NeckSpec:
        """The neck with the limits of the run."""
        return NeckSpec.model_validate(json.loads(self.about)["neck"])

    def save(self, path: Path) -> None:
        """Write the record.

        Args:
            path: File to write, ending in ``.npz``.
        """
        write_whole(path, lambda file: np.savez_compressed(file, **vars(self)))


def record(
    robot: Robot,
    clock: Clock,
    excitation_rad: FloatArray,
    neck: NeckSpec,
    about: dict[str, Any],
    on_tick: Callable[[float], object] = lambda _: None,
) -> NeckRecord:
    """Execute the excitation and record the response. After an interrupt the command is first brought to rest.

    Args:
        robot: Connected; stays connected.
        clock: The robot's clock.
        excitation_rad: Commands from the present joint angles, one per servo period, shape (K, N), radians.
        neck: The neck with its servo rate, and the limits of the stop.
        about: Description of the origin; the neck is added.
        on_tick: Called after each tick with the completed share, 0 to 1.

    Returns:
        The record.

    Raises:
        RobotError: If a command is not accepted, readings fail for half a second, or a tick is late by more than
            0.15 s.
        KeyboardInterrupt: If interrupted, after the stop.
    """
    commands: list[tuple[float, FloatArray]] = []
    readings: list[tuple[float, FloatArray]] = []
    failed, silent_since_s = 0, clock.now_s()
    start_s = clock.now_s() + neck.servo_period_s
    try:
        for tick, wanted_rad in enumerate(excitation_rad):
            due_s = start_s + tick * neck.servo_period_s
            clock.sleep_until_s(due_s)
            # After a late tick the schedule is shifted: skipped commands would cause a step.
            late_s = clock.now_s() - due_s
            # Longest delay of a tick: continuing at the previous speed would cause a jerk.
            if late_s > 0.15:
                raise RobotError(f"stopped: a tick was {1e3 * late_s:.0f} ms late; reduce the load of this computer")
            if late_s > neck.servo_period_s:
                start_s += late_s
            try:
                state = checked_reading(robot.read_state(), neck)
                silent_since_s = clock.now_s()
                if state is not None:
                    readings.append((state.time_s, state.position_rad))
            except Exception as error:
                failed += 1
                if clock.now_s() - silent_since_s > _SILENCE_S:
                    why = f"the joints could not be read for {_SILENCE_S} s ({error_line(error)})"
                    raise RobotError(f"stopped: {why}") from error
            sent_at_s = clock.now_s()
            try:
                sent_rad = numbers("the result of send_command()", robot.send_command(wanted_rad), (neck.joints,))
            except Exception as error:
                why = f"a command failed ({error_line(error)})"
                raise RobotError(f"stopped after {sent_at_s - start_s:.1f} s: {why}") from error
            commands.append((sent_at_s, sent_rad))
            on_tick(tick / len(excitation_rad))
    except BaseException:
        # After any exception the robot is stopped if it still accepts commands.
        with contextlib.suppress(Exception), _undisturbed():
            _stop(robot, clock, neck, excitation_rad[: max(len(commands), 1)])
        raise
    return NeckRecord(
        about=json.dumps({**about, "neck": neck.model_dump()}, sort_keys=True),
        command_time_s=np.array([t for t, _ in commands]),
        command_rad=np.array([u for _, u in commands]),
        joint_time_s=np.array([t for t, _ in readings], dtype=float),
        joint_rad=np.array([q for _, q in readings], dtype=float).reshape(-1, neck.joints),
        failed_reads=failed,
    )


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Ignore signals: a second Ctrl-C must not interrupt the braking that the first one caused."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    main = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, signal.SIG_IGN) for number in numbers} if main else {}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _stop(robot: Robot, clock: Clock, neck: NeckSpec, sent_rad: FloatArray) -> None:
    start_s = clock.now_s()
    # Before the first command the neck was at rest.
    for i, position_rad in enumerate(brake(neck, np.pad(sent_rad, ((3, 0), (0, 0)), mode="edge")[-3:])):
        clock.sleep_until_s(start_s + i * neck.servo_period_s)
        robot.send_command(position_rad)


def load_record(path: Path | str) -> NeckRecord:
    """Read a record, or convert a log of `gazempc.run`.

    Args:
        path: File written by `NeckRecord.save` or `gazempc.results.log.Log.save`.

    Returns:
        The record.

    Raises:
        SettingsError: If the file is missing or neither of them.
    """
    values, wanted = read_arrays(path), {f.name for f in fields(NeckRecord)}
    if wanted <= values.keys():
        return _record(path, {name: values[name] for name in wanted})
    log = load_log(path)
    # The log has one row per tick, with NaN for missing readings.
    measured = np.isfinite(log.joint_position_rad).all(axis=1)
    return NeckRecord(
        about=json.dumps({"from": f"log {Path(path).name}", "neck": log.neck.model_dump()}, sort_keys=True),
        command_time_s=log.time_s,
        command_rad=log.command_position_rad,
        # A simulation's log has the state at the tick, without times of readings.
        joint_time_s=np.where(np.isfinite(log.joint_time_s), log.joint_time_s, log.time_s)[measured],
        joint_rad=log.joint_position_rad[measured],
    )


def _record(path: Path | str, values: dict[str, Any]) -> NeckRecord:
    """A record from a file's arrays.

    Raises:
        SettingsError: If the arrays are inconsistent, or the description of the neck is invalid.
    """
    try:
        found = NeckRecord(**values | {"about": str(values["about"]), "failed_reads": int(values["failed_reads"])})
        joints = found.neck().joints
    except (ValueError, TypeError, KeyError, RecursionError) as error:  # pydantic's errors are ValueErrors
        raise SettingsError(f"{path}: the description of the record cannot be read: {shown(str(error), 200)}") from None
    for side in ("command", "joint"):
        times_s, angles_rad = values[f"{side}_time_s"], values[f"{side}_rad"]
        kinds = {times_s.dtype.kind, angles_rad.dtype.kind}
        if times_s.ndim != 1 or angles_rad.shape != (times_s.size, joints) or kinds != {"f"}:
            shapes = f"{times_s.shape} and {angles_rad.shape}; accepted: (N,) and (N, {joints}), floats"
            raise SettingsError(f"{path}: {side}_time_s and {side}_rad have the shapes {shapes}")
        if not (np.abs(angles_rad) < _LARGEST).all() or not (np.abs(times_s) < _LARGEST).all():
            raise SettingsError(f"{path}: {side}_time_s or {side}_rad has non-finite or implausibly large values")
    return found
