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

from benchmarks.faults.machine import GapMs
from benchmarks.faults.runs import Count, Wrong, watch
from benchmarks.faults.tracker import TCP_FAULTS, head_m
from gazempc.live.run import LiveRun
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import build
from gazempc.results.metrics import measure

# What is wrong with the tracker, its clock or the network.
LIVE_FAULTS = (
    "none", "stranger", "strange_flood", "flood", *TCP_FAULTS, "clock_ahead", "clock_fast", "clock_behind",
    "impossible_heads",
)  # fmt: skip


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
    # A busy computer takes up to a minute to begin a run; the tracker is ended with it.
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
