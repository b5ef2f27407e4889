"""A long live run on the real clock: `python -m benchmarks.soak`.

A synthetic person walks to and fro for ever. The loop plans in the background and sends commands to a simulated neck,
as `python -m gazempc.live` does, and writes its logs to a temporary folder. Reported: how late the ticks were, skipped
ticks, the time from capture to command, the load of a processor core, memory after the first minute and at the end,
and violated limits. Progress
goes to standard error. Lateness depends on the machine, and on what else it does.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import tempfile
import threading
import time
from collections import deque
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from gazempc.live.clock import Clock, RealClock
from gazempc.live.process import fast_switching, without_collection
from gazempc.live.run import LiveRun
from gazempc.live.run_report import LiveReport
from gazempc.live.setup import LiveSetup
from gazempc.live.sources.source import Arrived
from gazempc.loop.build import Person, make_controller, make_predictor
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.results.log import ComputeTimes, Log, RunInfo
from gazempc.results.motion import limit_violations
from gazempc.sim.replay import ReplaySettings
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import FloatArray, Sighting
from predictors import HeadObservation

FRAME_S = 1.0 / 30.0
LATENCY_S = 0.066
NOISE_M = 0.01
WARM_UP_S = 60.0
# Distance, half of the way to and fro (m), and the time for it there and back (s).
WALK_M, HALF_WAY_M, PERIOD_S = 2.5, 1.5, 10.0


def head_m(times_s: FloatArray) -> FloatArray:
    """Where the person's head is: to and fro across the robot's view, bobbing with the steps, shape (H, 3)."""
    phase = 2.0 * np.pi * times_s / PERIOD_S
    return np.stack(
        [
            WALK_M + 0.3 * np.sin(0.5 * phase),
            HALF_WAY_M * np.sin(phase),
            0.4 + 0.02 * np.sin(2.0 * np.pi * 1.8 * times_s),
        ],
        axis=-1,
    )


class EndlessWalk:
    """A source that never ends: the person as a camera at 30 fps sees them.

    Args:
        clock: The loop's clock.
        seed: Seed of the camera's noise.
    """

    def __init__(self, clock: Clock, seed: int) -> None:
        self._clock = clock
        self._rng = np.random.default_rng(seed)
        self._frame = 0
        self.start_s = 0.0

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`."""
        self.start_s = self._clock.now_s()

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        elapsed_s = self._clock.now_s() - self.start_s
        arrived = []
        while (captured_s := self._frame * FRAME_S) + LATENCY_S <= elapsed_s:
            seen_m = head_m(np.array(captured_s)) + self._rng.normal(0.0, NOISE_M, 3)
            observation = HeadObservation(self.start_s + captured_s, seen_m)
            arrived.append(Sighting(self.start_s + captured_s + LATENCY_S, observation))
            self._frame += 1
        return Arrived(tuple(arrived))

    @property
    def finished(self) -> bool:
        """See `gazempc.live.sources.source.Source.finished`: never."""
        return False

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""


class Kept:
    """Writes the logs, each over the one before, and keeps the figures of the latest ones.

    Args:
        neck: The neck.
        folder: Where to write.
    """

    def __init__(self, neck: NeckSpec, folder: Path) -> None:
        self._neck, self._folder = neck, folder
        self.violations = 0
        self.logs = 0
        # About an hour of plans: of a longer run the last hour counts.
        self._latency_ms: deque[float] = deque(maxlen=180_000)

    def keep(self, log: Log, times: ComputeTimes) -> None:
        """Take a complete log."""
        log.save(self._folder / "log.npz")
        times.save(self._folder / "compute.npz")
        self.violations += limit_violations(log, self._neck) if log.time_s.size > 3 else 0
        self.logs += 1
        self._latency_ms.extend(times.latency_ms.tolist())

    def latency_ms(self, percent: float) -> float | None:
        """A percentile of the time from capture to command, milliseconds."""
        return float(np.percentile(self._latency_ms, percent)) if self._latency_ms else None


def rss_mib() -> float:
    """Memory that this process has in use now, MiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2.0**20


class Watch:
    """Looks at memory every few seconds, in a thread of its own.

    Args:
        report: What the run has done so far.
        every_s: Time between two looks, seconds.
    """

    def __init__(self, report: LiveReport, every_s: float) -> None:
        self._report, self._every_s = report, every_s
        self._ended = threading.Event()
        self._started_s = time.monotonic()
        self.looks: list[tuple[float, float]] = []
        self._thread = threading.Thread(target=self._work, name="watch", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._started_s = time.monotonic()
        self._thread.start()

    def stop(self) -> None:
        """End, with a last look."""
        self._ended.set()
        self._thread.join()
        self._look()

    def _work(self) -> None:
        while not self._ended.wait(self._every_s):
            self._look()

    def _look(self) -> None:
        elapsed_s, used_mib = time.monotonic() - self._started_s, rss_mib()
        self.looks.append((elapsed_s, used_mib))
        late = self._report.lateness
        print(
            f"{elapsed_s:6.0f} s: {self._report.ticks} ticks, {self._report.skipped_ticks} skipped, "
            f"later than due by {late.percentile_ms(99):.2f} ms (p99), {late.max_ms:.1f} ms (max), {used_mib:.1f} MiB",
            file=sys.stderr,
            flush=True,
        )


def growth_mib_per_min(looks: list[tuple[float, float]]) -> float | None:
    """Slope of the memory in use after the first minute, by least squares; None if the run was too short for it."""
    late = np.array([look for look in looks if look[0] >= WARM_UP_S])
    if len(late) < 3:
        return None
    return 60.0 * float(np.polyfit(late[:, 0], late[:, 1], 1)[0])


def soak(minutes: float, neck: NeckSpec, log_s: float, seed: int) -> dict[str, Any]:
    """Run for some minutes.

    Args:
        minutes: How long.
        neck: The neck, with its rates.
        log_s: Length of a log, seconds.
        seed: Seed of the camera's noise.

    Returns:
        The figures.
    """
    settings = ReplaySettings()
    clock = RealClock()
    controller = make_controller("mpc", neck, settings, {})
    robot = SimulatedNeck(neck, neck.rest_rad, clock.now_s)
    source = EndlessWalk(clock, seed)
    with tempfile.TemporaryDirectory() as folder:
        kept = Kept(neck, Path(folder))
        about = RunInfo(
            recording="endless walk",
            kind="live",
            subject="nobody",
            controller="mpc",
            predictor=settings.predictor,
            neck=neck,
            sensor={"name": "camera"},
            seed=seed,
            mode="live",
            joints="measured",
        )
        setup = LiveSetup(
            about,
            neck,
            make_predictor(settings.predictor, settings, Person(), {}),
            controller,
            robot,
            source,
            clock,
            true_head_base_m=lambda times_s: head_m(times_s - source.start_s),
            log_s=log_s,
        )
        run = LiveRun(setup, kept.keep)
        watch = Watch(run.report, every_s=min(5.0, 60.0 * minutes / 4))
        watch.start()
        started_s, used_s = time.monotonic(), time.process_time()
        with fast_switching(), without_collection():
            report = run.run(threading.Event(), 60.0 * minutes)
        core_percent = 100.0 * (time.process_time() - used_s) / (time.monotonic() - started_s)
        gc.collect()
        watch.stop()
    late = report.lateness
    warm = [used for elapsed_s, used in watch.looks if elapsed_s >= min(WARM_UP_S, 30.0 * minutes)]
    return {
        "minutes": minutes,
        "rate_hz": neck.servo_rate_hz,
        "log_s": log_s,
        "logs": kept.logs,
        "ticks": report.ticks,
        "skipped_ticks": report.skipped_ticks,
        "lateness_ms": {"p50": late.percentile_ms(50), "p99": late.percentile_ms(99), "max": late.max_ms},
        "end_to_end_latency_ms": {"p50": kept.latency_ms(50), "p99": kept.latency_ms(99)},
        "core_percent": core_percent,
        "rss_mib": {"after_first_minute": warm[0], "end": watch.looks[-1][1], "max": max(warm)},
        "growth_mib_per_min": growth_mib_per_min(watch.looks),
        "limit_violations": kept.violations,
        "observations": report.observations,
    }


def main(
    minutes: float = 10.0,
    rate_hz: float = 100.0,
    log_s: float = 60.0,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
) -> None:
    """Run and print.

    Args:
        minutes: How long.
        rate_hz: Commands a second; half as many plans.
        log_s: A log is written each time so many seconds have passed.
        json_file: Where to save the figures.
    """
    neck = load_neck("reference").model_copy(update={"servo_rate_hz": rate_hz, "control_rate_hz": rate_hz / 2.0})
    found = soak(minutes, neck, log_s, seed=0)
    late, latency, used = found["lateness_ms"], found["end_to_end_latency_ms"], found["rss_mib"]
    print(f"{found['ticks']} ticks in {minutes:g} min at {rate_hz:g} Hz, {found['skipped_ticks']} skipped")
    print(f"later than due by {late['p50']:.2f} ms (p50), {late['p99']:.2f} ms (p99), {late['max']:.2f} ms (max)")
    if latency["p50"] is not None:
        print(f"from capture to command: {latency['p50']:.0f} ms (p50), {latency['p99']:.0f} ms (p99)")
    print(f"load: {found['core_percent']:.0f} % of one core")
    growth = found["growth_mib_per_min"]
    print(
        f"memory: {used['after_first_minute']:.1f} MiB after the first minute, {used['end']:.1f} MiB at the end, "
        + ("too short to tell growth" if growth is None else f"{growth:+.2f} MiB a minute")
    )
    print(f"limit violations: {found['limit_violations']}")
    if json_file is not None:
        json_file.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.soak", description=__doc__)
