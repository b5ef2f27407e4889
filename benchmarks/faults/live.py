"""Live runs on the real clock under attacks and faults: each command counted and timed."""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.faults.person import head_m
from benchmarks.faults.tracker import RATE_HZ, TCP_FAULTS
from gazempc.controllers.controller import Controller, Plan, Situation
from gazempc.live.process import fast_switching, without_collection
from gazempc.live.run import LiveRun
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import LiveSetup, build
from gazempc.neck.spec import NeckSpec
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.motion import limit_violations
from gazempc.robots.robot import Robot
from gazempc.types import FloatArray, JointState
from predictors import Forecast, HeadObservation, Predictor

# What is wrong with the tracker, its clock or the network, and with the run itself.
OF_TRACKER = (
    "none", "stranger", "strange_flood", "flood", *TCP_FAULTS, "clock_ahead", "clock_fast", "clock_behind",
    "impossible_heads",
)  # fmt: skip
OF_RUN = ("long_log", "slow_predictor", "slow_planner", "predictor_raises")
LIVE_FAULTS = (*OF_TRACKER, *OF_RUN)
_SETTLED_S = 2.0
# As long as the logs of a live run are by default; most of it is made up before the run.
_LONG_LOG_S = 300.0
_SLOW_PREDICTOR_S, _SLOW_PLANNER_S = 0.004, 0.05


@dataclass(frozen=True)
class LiveCount:
    """What came of one live run.

    Attributes:
        fault: What was wrong.
        commands: Commands that the robot got.
        not_finite: How many of them were not finite.
        outside_limits: Violations of the neck's limits in the log.
        gap_p99_ms: Time between two commands, 99 % are below.
        gap_max_ms: The longest.
        skipped_ticks: Ticks left out.
        observations: How many arrived.
        used: How many were used.
        refused: How many were not, by reason.
        gaze_error_rms_deg: Of the gaze against the true head, from 2 s on.
        warnings: What the run said was wrong.
    """

    fault: str
    commands: int
    not_finite: int
    outside_limits: int
    gap_p99_ms: float
    gap_max_ms: float
    skipped_ticks: int
    observations: int
    used: int
    refused: dict[str, int]
    gaze_error_rms_deg: float
    warnings: list[str]


class Timed:
    """A robot whose commands are counted and timed."""

    def __init__(self, inner: Robot) -> None:
        self._inner = inner
        self.true_state = getattr(inner, "true_state", None)
        self.times_s: list[float] = []
        self.not_finite = 0

    def connect(self) -> None:
        """See `gazempc.robots.robot.Robot.connect`."""
        self._inner.connect()

    def read_state(self) -> JointState | None:
        """See `gazempc.robots.robot.Robot.read_state`."""
        return self._inner.read_state()

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """See `gazempc.robots.robot.Robot.send_command`."""
        self.times_s.append(time.monotonic())
        self.not_finite += not bool(np.isfinite(position_rad).all())
        return self._inner.send_command(position_rad)

    def close(self) -> None:
        """See `gazempc.robots.robot.Robot.close`."""
        self._inner.close()


class Hampered:
    """A predictor that takes its time, or raises now and then."""

    def __init__(self, inner: Predictor, hamper: Callable[[int], None]) -> None:
        self._inner, self._hamper, self._updates = inner, hamper, 0
        self.reset, self.forecast = inner.reset, inner.forecast

    def update(self, observation: HeadObservation) -> None:
        """See `predictors.predictor.Predictor.update`."""
        self._updates += 1
        self._hamper(self._updates)
        self._inner.update(observation)


class Slow:
    """A controller that computes for long."""

    def __init__(self, inner: Controller) -> None:
        self._inner = inner
        self.reset, self.forecast_times_s = inner.reset, inner.forecast_times_s

    def plan(self, situation: Situation) -> Plan:
        """See `gazempc.controllers.controller.Controller.plan`."""
        _compute(_SLOW_PLANNER_S)
        return self._inner.plan(situation)


def _compute(seconds: float) -> None:
    until_s = time.perf_counter() + seconds
    while time.perf_counter() < until_s:
        pass


def _raise_at_times(update: int) -> None:
    if update % 3 == 0:
        raise ValueError("made to fail")


def run_live(fault: str, seconds: float, neck: str = "reference") -> LiveCount:
    """One run.

    Args:
        fault: One of `LIVE_FAULTS`.
        seconds: How long.
        neck: The neck.

    Returns:
        What came of it.
    """
    port, kind = _free_port(), "tcp" if fault in TCP_FAULTS else "udp"
    log_s = _LONG_LOG_S if fault == "long_log" else 300.0
    with tempfile.TemporaryDirectory() as folder, _tracker(fault, port, seconds + 3.0) as tracker:
        settings = LiveSettings(source=f"{kind}:127.0.0.1:{port}", neck=neck, out=Path(folder), log_s=log_s)
        setup = _changed(build(settings), fault)
        spec = setup.neck
        robot = Timed(setup.robot)
        logs: list[Log] = []
        unix_s = time.time() - setup.clock.now_s()

        def keep(log: Log, times: ComputeTimes) -> None:
            log.save(Path(folder) / f"log_{len(logs)}.npz")
            logs.append(log)

        def begun() -> None:
            if tracker.stdin is not None:
                tracker.stdin.write(b"\n")
                tracker.stdin.flush()
            if fault == "long_log":
                _fill(run, spec, log_s - 1.0)

        def true_head(times_s: FloatArray) -> FloatArray:
            return head_m(times_s + unix_s)

        run = LiveRun(replace(setup, robot=robot, true_head_base_m=true_head), keep)
        with fast_switching(), without_collection():
            began_s = setup.clock.now_s()
            run.run(threading.Event(), seconds, begun)
    gaps_ms = 1e3 * np.diff(robot.times_s)
    return LiveCount(
        fault=fault,
        commands=len(robot.times_s),
        not_finite=robot.not_finite,
        outside_limits=sum(limit_violations(log, spec) for log in logs if log.time_s.size > 3),
        gap_p99_ms=round(float(np.percentile(gaps_ms, 99)), 2),
        gap_max_ms=round(float(gaps_ms.max()), 2),
        skipped_ticks=run.report.skipped_ticks,
        observations=run.report.observations,
        used=run.logs.used,
        refused=run.logs.refused,
        gaze_error_rms_deg=round(_error_deg(logs, began_s), 2),
        warnings=run.report.warnings,
    )


def _fill(run: LiveRun, neck: NeckSpec, seconds: float) -> None:
    """As if the run had gone on for so long already: its first log is handed over soon."""
    rest, zero = neck.rest_rad, np.zeros(neck.joints)
    motions = tuple((float(angle), 0.0, 0.0) for angle in rest)
    for tick in range(int(seconds * neck.servo_rate_hz)):
        run.logs.note_true_joints(tick * neck.servo_period_s - seconds)
        run.logs.recorder.tick(tick * neck.servo_period_s - seconds, JointState(0.0, rest, zero), rest, motions)
    empty = Forecast(np.zeros(3), np.zeros((3, 3)), np.tile(np.eye(3), (3, 1, 1)), 0.0)
    for frame in range(int(seconds * RATE_HZ)):
        seen = HeadObservation(frame / RATE_HZ - seconds, np.array([2.0, 0.0, 0.4]))
        run.logs.recorder.observation(frame / RATE_HZ - seconds, seen, empty, 0.1, used=False)


def _changed(setup: LiveSetup, fault: str) -> LiveSetup:
    if fault == "slow_predictor":
        return replace(setup, predictor=Hampered(setup.predictor, lambda _: _compute(_SLOW_PREDICTOR_S)))
    if fault == "predictor_raises":
        return replace(setup, predictor=Hampered(setup.predictor, _raise_at_times))
    return replace(setup, controller=Slow(setup.controller)) if fault == "slow_planner" else setup


def _error_deg(logs: list[Log], began_s: float) -> float:
    """RMS of the reference neck's gaze error, whose axes and eye are in the origin."""
    errors = []
    for log in logs:
        scored = log.time_s > _SETTLED_S + began_s
        pan, tilt = log.joint_position_rad[scored, :2].T
        gaze = np.stack([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), np.sin(tilt)], axis=1)
        head = log.head_true_base_m[scored]
        errors.append(np.arccos(np.clip(np.sum(gaze * head, axis=1) / np.linalg.norm(head, axis=1), -1.0, 1.0)))
    return float(np.rad2deg(np.sqrt(np.mean(np.concatenate(errors) ** 2))))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def _tracker(fault: str, port: int, seconds: float) -> Iterator[subprocess.Popen[bytes]]:
    words = [sys.executable, "-m", "benchmarks.faults.tracker", fault, str(port), str(seconds)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        if process.stdout is not None:
            process.stdout.readline()  # it is ready
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def busy(cores: int) -> Iterator[None]:
    """Processes that compute all the time.

    Args:
        cores: How many.
    """
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(cores)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()
