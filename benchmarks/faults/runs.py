"""Real-time runs with fault injection: attacks on the tracker, and faulty parts.

Each command is counted and timed, and the logs are loaded again.
"""

from __future__ import annotations

import contextlib
import math
import socket
import subprocess
import sys
import tempfile
import threading
import time
import timeit
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.faults.machine import GapMs
from benchmarks.faults.tracker import TCP_FAULTS, head_m
from benchmarks.faults.wrongs import FAMILIES, ISOLATED, hold_lock
from gazempc.live.process import IsolatedPredictor, fast_switching, without_collection
from gazempc.live.run import LiveRun
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import LiveSetup, build
from gazempc.neck.spec import NeckSpec
from gazempc.results.log import Log
from gazempc.results.log_files import load_log
from gazempc.results.metrics import measure
from gazempc.types import FloatArray
from predictors import ConstantVelocity, Forecast, HeadObservation


class Wrong:
    """Proxy of a part that modifies the result of one method and records a robot's commands.

    Args:
        inner: The part.
        method: Name of the method; empty for none.
        change: Function from the original to the returned result.

    Attributes:
        sent: Times and commands.
    """

    # Handled like a real robot.
    keeps_any_clock = False

    def __init__(self, inner: Any, method: str = "", change: Callable[[Any], Any] = lambda answer: answer) -> None:
        self._inner, self._method, self._change = inner, method, change
        self.sent: list[tuple[float, Any]] = []

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._inner, name)
        if name != self._method:
            return found
        return (lambda *args: self._change(found(*args))) if callable(found) else self._change(found)

    def send_command(self, position_rad: Any) -> Any:
        """See `gazempc.robots.robot.Robot.send_command`."""
        self.sent.append((time.monotonic(), position_rad.copy()))
        return self.__getattr__("send_command")(position_rad)


@dataclass(frozen=True)
class Count:
    """Counts and times of one run.

    Attributes:
        family: ``simulated``, ``live``, or part and method.
        kind: Injected fault.
        commands: Number of commands sent.
        outside_limits: Number of non-finite commands, and of violations of the neck's limits.
        observations: Number of observations received.
        used: Number of observations used.
        refused: Number of rejected observations, by reason.
        gap_max_ms: Longest time between two commands.
        machine_gap_ms: Longest gap of an undisturbed process in that interval.
        ended: Whether the fault ended the run.
        log_lost: Whether a log is missing, cannot be loaded or lacks ticks.
        named: Event with the part's class and method; empty if there is none.
        gaze_error_rms_deg: RMS gaze error relative to the true head; None for parts.
    """

    family: str
    kind: str
    commands: int
    outside_limits: int
    observations: int
    used: int
    refused: dict[str, int]
    gap_max_ms: float = 0.0
    machine_gap_ms: float = 0.0
    ended: bool = False
    log_lost: bool = False
    named: str = ""
    gaze_error_rms_deg: float | None = None


def outside_limits(sent_rad: FloatArray, neck: NeckSpec) -> int:
    """Count violations of the limits.

    Args:
        sent_rad: Commands at the servo rate, shape (M, N), radians.
        neck: The limits.

    Returns:
        Number of values that are not finite, positions out of range, and differences up to third order beyond a limit.
    """
    count = int(np.sum(~np.isfinite(sent_rad)))
    count += int(np.sum((sent_rad > neck.position_max_rad + 1e-9) | (sent_rad < neck.position_min_rad - 1e-9)))
    padded = np.vstack([np.tile(sent_rad[0], (3, 1)), sent_rad])
    limits = (neck.velocity_max_rad_s, neck.acceleration_max_rad_s2, neck.jerk_max_rad_s3)
    for order, limit in enumerate(limits, 1):
        moved = np.abs(np.diff(padded, order, axis=0)) / neck.servo_period_s**order
        count += int(np.sum(moved > limit * (1 + 1e-6)))
    return count


def watch(
    setup: LiveSetup, names: tuple[str, str], seconds: float, machine_gap_ms: GapMs, on_ready: Callable[[LiveRun], None]
) -> tuple[Count, list[Log]]:
    """Run in real time, like the live command.

    Args:
        setup: Parts of the run; the robot is a `Wrong`.
        names: Family and kind.
        seconds: Duration.
        machine_gap_ms: See `benchmarks.faults.machine.control`.
        on_ready: Called before the first tick.

    Returns:
        Counts and logs.
    """
    robot, ended, logs = setup.robot, False, []
    assert isinstance(robot, Wrong)
    with tempfile.TemporaryDirectory() as folder:
        paths: list[Path] = []

        def keep(log: Log, times: object) -> None:
            paths.append(Path(folder) / f"{len(paths)}.npz")
            log.save(paths[-1])

        run = LiveRun(setup, keep)
        with fast_switching(), without_collection():
            try:
                run.run(threading.Event(), seconds, lambda: on_ready(run))
            except BaseException as error:
                if isinstance(error, KeyboardInterrupt):
                    raise
                ended = True
                print(f"{names}: {type(error).__name__}: {error}", file=sys.stderr)
        with contextlib.suppress(Exception):
            logs = [load_log(path) for path in paths]
    sent_s = [time_s for time_s, _ in robot.sent]
    longest = int(np.diff(sent_s).argmax())
    around_s = sent_s[longest : longest + 2]
    faults = [f"{fault.event}: {fault.error}" for fault in run.logs.faults]
    return Count(
        *names,
        commands=len(sent_s),
        outside_limits=outside_limits(np.array([command_rad for _, command_rad in robot.sent]), setup.neck),
        observations=run.report.observations,
        used=run.logs.used,
        refused=run.logs.refused,
        gap_max_ms=round(1e3 * (around_s[1] - around_s[0]), 1),
        machine_gap_ms=round(machine_gap_ms(*around_s), 1),
        ended=ended,
        log_lost=sum(log.time_s.size for log in logs) != run.report.ticks,
        named=next((fault for fault in faults if "Wrong" in fault), ""),
    ), logs


# Faults of the tracker, its clock or the network.
LIVE_FAULTS = (
    "none", "stranger", "strange_flood", "flood", *TCP_FAULTS, "clock_ahead", "clock_fast", "clock_behind",
    "impossible_heads",
)  # fmt: skip


def run_live(fault: str, seconds: float, machine_gap_ms: GapMs) -> Count:
    """Execute one run.

    Args:
        fault: One of `LIVE_FAULTS`.
        seconds: Duration.
        machine_gap_ms: See `benchmarks.faults.machine.control`.

    Returns:
        The counts.
    """
    port, kind = _free_port(), "tcp" if fault in TCP_FAULTS else "udp"
    # A loaded machine takes up to a minute to start a run; the tracker ends with the run.
    with _tracker(fault, port, seconds + 60.0) as tracker:
        setup = build(LiveSettings(source=f"{kind}:127.0.0.1:{port}", out=Path()))
        unix_s = time.time() - setup.clock.now_s()

        def begun(run: LiveRun) -> None:
            print(file=tracker, flush=True)

        true_head = lambda times_s: head_m(times_s + unix_s)  # noqa: E731
        spoilt = replace(setup, robot=Wrong(setup.robot), true_head_base_m=true_head)
        count, logs = watch(spoilt, ("live", fault), seconds, machine_gap_ms, begun)
    return replace(count, gaze_error_rms_deg=round(measure(logs[-1]).gaze_error_rms_deg, 2))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def _tracker(fault: str, port: int, seconds: float) -> Iterator[IO[str]]:
    """Start the tracker and wait until it is ready; yields its standard input."""
    words = [sys.executable, "-m", "benchmarks.faults.tracker", fault, str(port), str(seconds)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        process.stdout.readline()  # type: ignore[union-attr]
        try:
            yield process.stdin  # type: ignore[misc]
        finally:
            process.kill()


_FROM_S = 0.5


class Holding(ConstantVelocity):
    """A predictor that intermittently holds the global interpreter lock."""

    forecasts = 0

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """See `predictors.predictor.Predictor.forecast`."""
        self.forecasts += 1
        if self.forecasts % 50 == 0:
            hold_lock(None)
        return super().forecast(times_s)


def run_part(family: str, kind: str, machine_gap_ms: GapMs, seconds: float) -> Count:
    """Execute one run.

    Args:
        family: One of `FAMILIES`.
        kind: Fault of that family.
        machine_gap_ms: See `benchmarks.faults.machine.control`.
        seconds: Duration.

    Returns:
        The counts.
    """
    part, _, method = family.partition(",")[0].partition(".")
    # Parts with a short construction time, for a hundred runs.
    settings = LiveSettings(source="replay", replay="subject03_R4", out=Path())
    setup = build(settings.model_copy(update={"controller": "lookahead", "predictor": "constant_velocity"}))
    if family == ISOLATED:
        setup = replace(setup, predictor=IsolatedPredictor(Holding))
    wrong_from_s, change = [math.inf], FAMILIES[family][kind]

    def begin(run: LiveRun) -> None:
        wrong_from_s[0] = setup.clock.now_s() + _FROM_S

    def later(answer: object) -> object:
        return change(answer) if setup.clock.now_s() > wrong_from_s[0] else answer

    names = ("robot", "source", "controller", "predictor")
    parts = {name: Wrong(getattr(setup, name), method * (part == name.capitalize()), later) for name in names}
    spoilt = replace(setup, **parts)  # type: ignore[arg-type]
    return watch(spoilt, (family, kind), seconds, machine_gap_ms, begin)[0]


def isolation_ms(calls: int) -> tuple[float, float]:
    """Overhead of a separate process: time of a forecast there minus the time in this process, milliseconds.

    Args:
        calls: Number of calls.

    Returns:
        Difference of the medians, and 99th percentile there minus the median here.
    """
    times_s, took_ms = 0.1 + 0.02 * np.arange(25), []
    for predictor in (ConstantVelocity(), IsolatedPredictor(ConstantVelocity)):
        predictor.update(HeadObservation(0.0, np.array([2.0, 0.0, 0.4])))
        took_ms.append(1e3 * np.array(timeit.repeat(partial(predictor.forecast, times_s), number=1, repeat=calls)))
    here, there = took_ms
    return tuple(round(float(np.percentile(there, p) - np.median(here)), 2) for p in (50, 99))  # type: ignore[return-value]
