"""Endurance test of a live run in real time: `python -m benchmarks.soak`.

A synthetic person walks past repeatedly. As in `gazempc live`, the loop plans in the background, commands a simulated
neck, and writes logs, here to a temporary folder. Results: lateness of ticks, skipped ticks, load of a processor core,
memory after the first minute and at the end, and limit violations. Lateness depends on the machine and its load.
"""

from __future__ import annotations

import gc
import os
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from gazempc.live.process import fast_switching, without_collection
from gazempc.live.run import LiveRun
from gazempc.live.session import parse
from gazempc.live.setup import build
from gazempc.loop.build import make_controller
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.motion import limit_violations
from gazempc.sim.replay import ReplaySettings
from gazempc.sim.simulated import SimulatedNeck

WARM_UP_S = 60.0
# Upper bound of the number of passes per minute.
_PASSES_PER_MIN = 20


def rss_mib() -> float:
    """Resident set size of this process, MiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2.0**20


def soak(minutes: float, neck: NeckSpec) -> dict[str, Any]:
    """Run for a duration.

    Args:
        minutes: Duration, minutes.
        neck: The neck, with its rates.

    Returns:
        Metrics by name.
    """
    passes = str(2 + round(_PASSES_PER_MIN * minutes))
    setup = build(parse(["--source", "replay", "--passes", passes, "--no-figures", "--log", "npz"]))
    setup = replace(
        setup,
        neck=neck,
        controller=make_controller("mpc", neck, ReplaySettings(), {}),
        robot=SimulatedNeck(neck, neck.rest_rad, setup.clock.now_s),
        log_s=60.0,
    )
    violations: list[int] = []
    used: list[tuple[float, float]] = []
    ended = threading.Event()
    with tempfile.TemporaryDirectory() as folder:

        def keep(log: Log, times: ComputeTimes) -> None:
            log.save(Path(folder) / "log.npz")
            times.save(Path(folder) / "compute.npz")
            violations.append(limit_violations(log, neck) if log.time_s.size > 3 else 0)

        run, started_s, cpu_s = LiveRun(setup, keep), time.monotonic(), time.process_time()

        def watch() -> None:
            while not ended.wait(min(5.0, 15.0 * minutes)):
                used.append((time.monotonic() - started_s, rss_mib()))
                print(f"{used[-1][0]:6.0f} s: {run.report.ticks} ticks, {used[-1][1]:.1f} MiB", file=sys.stderr)

        watcher = threading.Thread(target=watch, daemon=True)
        watcher.start()
        with fast_switching(), without_collection():
            report = run.run(threading.Event(), 60.0 * minutes)
        core_percent = 100.0 * (time.process_time() - cpu_s) / (time.monotonic() - started_s)
        gc.collect()
        ended.set()
        watcher.join()
    used.append((time.monotonic() - started_s, rss_mib()))
    warm = np.array([each for each in used if each[0] >= min(WARM_UP_S, 30.0 * minutes)])
    late = report.lateness
    return {
        "minutes": minutes,
        "rate_hz": neck.servo_rate_hz,
        "ticks": report.ticks,
        "skipped_ticks": report.skipped_ticks,
        "lateness_ms": {"p50": late.percentile_ms(50), "p99": late.percentile_ms(99), "max": late.max_ms},
        "core_percent": core_percent,
        "rss_mib": {"after_first_minute": warm[0, 1], "end": used[-1][1], "max": warm[:, 1].max()},
        "limit_violations": sum(violations),
    }


def main(minutes: float = 10.0, rate_hz: float = 100.0) -> None:
    """Run and print.

    Args:
        minutes: Duration.
        rate_hz: Command rate; plans have half this rate.
    """
    neck = load_neck("reference").model_copy(update={"servo_rate_hz": rate_hz, "control_rate_hz": rate_hz / 2.0})
    for name, value in soak(minutes, neck).items():
        values = value.items() if isinstance(value, dict) else [("", value)]
        shown = ", ".join(f"{key} {each:.4g}".strip() if isinstance(each, float) else str(each) for key, each in values)
        print(f"{name.replace('_', ' ')}: {shown}")


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.soak", description=__doc__)
