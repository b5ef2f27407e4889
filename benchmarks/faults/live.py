"""Live runs on the real clock under attacks: each command counted and timed."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO

import numpy as np

from benchmarks.faults.machine import GapMs
from benchmarks.faults.runs import Count, Wrong, watch
from benchmarks.faults.tracker import RATE_HZ, TCP_FAULTS, head_m
from gazempc.live.run import LiveRun
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import build
from gazempc.neck.spec import NeckSpec
from gazempc.results.metrics import measure
from gazempc.types import JointState
from predictors import Forecast, HeadObservation

# What is wrong with the tracker, its clock or the network; and a log whose hand-over takes long.
LIVE_FAULTS = (
    "none", "stranger", "strange_flood", "flood", *TCP_FAULTS, "clock_ahead", "clock_fast", "clock_behind",
    "impossible_heads", "long_log",
)  # fmt: skip
# As long as the logs of a live run are by default; most of it is made up before the run.
_LONG_LOG_S = 300.0


def run_live(fault: str, seconds: float, machine_gap_ms: GapMs) -> Count:
    """One run.

    Args:
        fault: One of `LIVE_FAULTS`.
        seconds: How long.
        machine_gap_ms: See `benchmarks.faults.machine.control`.

    Returns:
        What came of it.
    """
    port, kind = _free_port(), "tcp" if fault in TCP_FAULTS else "udp"
    with _tracker(fault, port, seconds + 3.0) as tracker:
        setup = build(LiveSettings(source=f"{kind}:127.0.0.1:{port}", out=Path(), log_s=_LONG_LOG_S))
        unix_s = time.time() - setup.clock.now_s()

        def begun(run: LiveRun) -> None:
            print(file=tracker, flush=True)
            if fault == "long_log":
                _fill(run, setup.neck, _LONG_LOG_S - 1.0)

        true_head = lambda times_s: head_m(times_s + unix_s)  # noqa: E731
        spoilt = replace(setup, robot=Wrong(setup.robot), true_head_base_m=true_head)
        count, logs = watch(spoilt, ("live", fault), seconds, machine_gap_ms, begun)
    return replace(count, gaze_error_rms_deg=round(measure(logs[-1]).gaze_error_rms_deg, 2))


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


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def _tracker(fault: str, port: int, seconds: float) -> Iterator[IO[str]]:
    """Starts the tracker, and waits until it is ready; its standard input."""
    words = [sys.executable, "-m", "benchmarks.faults.tracker", fault, str(port), str(seconds)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        process.stdout.readline()  # type: ignore[union-attr]
        try:
            yield process.stdin  # type: ignore[misc]
        finally:
            process.kill()
