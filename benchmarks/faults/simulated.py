"""Tracker faults in simulated time, injected into the reference sensor's observations of a walk."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Event as StopEvent

import numpy as np

from benchmarks.faults.runs import Count, Wrong
from gazempc.live.run import LiveRun
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import build
from gazempc.live.sources.source import Arrived
from gazempc.results.log import Log
from gazempc.results.metrics import measure
from gazempc.results.motion import limit_violations
from gazempc.types import FloatArray, Sighting

Spoil = Callable[[Sighting, int, np.random.Generator], list[Sighting]]
WALKS = ("subject03_R4", "subject08_R6")
_FRAME_HZ = 30.0


def _poll(spoil: Spoil) -> Callable[[Arrived], Arrived]:
    """Inject a fault into each observation of a source."""
    frames, rng = itertools.count(), np.random.default_rng(0)
    return lambda found: Arrived(tuple(each for s in found.sightings for each in spoil(s, next(frames), rng)))


def _at(sighting: Sighting, head_m: FloatArray) -> list[Sighting]:
    return [replace(sighting, observation=replace(sighting.observation, head_position_base_m=head_m))]


def _head_m(sighting: Sighting) -> FloatArray:
    return sighting.observation.head_position_base_m


def _stamped(sighting: Sighting, later_s: float) -> list[Sighting]:
    seen = sighting.observation
    return [replace(sighting, observation=replace(seen, capture_time_s=seen.capture_time_s + later_s))]


def _each(frames: int) -> Spoil:
    return lambda s, k, rng: [s] if k % frames == 0 else []


def _periodic(every_s: float, long_s: float, spoil: Spoil) -> Spoil:
    """Inject a fault for `long_s` of each period `every_s`."""
    return lambda s, k, rng: spoil(s, k, rng) if k / _FRAME_HZ % every_s > every_s - long_s else [s]


def _spike(sighting: Sighting, frame: int, rng: np.random.Generator) -> list[Sighting]:
    way = rng.normal(size=3)
    far_m = rng.uniform(0.1, 0.5) * way / np.linalg.norm(way)
    return _at(sighting, _head_m(sighting) + far_m * (rng.random() < 0.1))


_ELSEWHERE_M, _TO_THE_LEFT = np.array([0.3, 1.5, 0.0]), np.array([0.0, 1.0, 0.0])
SIMULATED_FAULTS: dict[str, Spoil] = {
    "none": lambda s, k, rng: [s],
    "10 frames a second": _each(3),
    "5 frames a second": _each(6),
    "one frame in three is lost": lambda s, k, rng: [s] if rng.random() > 1 / 3 else [],
    "stamps 60 ms late": lambda s, k, rng: _stamped(s, 0.06),
    "stamps 100 ms early": lambda s, k, rng: _stamped(s, -0.1),
    "stamps 100 ms ahead of the clock": lambda s, k, rng: _stamped(s, 0.166),
    "clock 1 % fast": lambda s, k, rng: _stamped(s, 0.01 * s.observation.capture_time_s),
    "a clock of its own, hours off": lambda s, k, rng: _stamped(s, 7200.0),
    "one frame in ten is a spike of 0.1 to 0.5 m": _spike,
    "range wrong by 15 % at each frame": lambda s, k, rng: _at(s, _head_m(s) * (1 + 0.15 * rng.normal())),
    "two people, alternate frames": lambda s, k, rng: _at(s, _head_m(s) + _ELSEWHERE_M * (k % 2)),
    "another person for 0.7 s of 1.8 s": _periodic(1.8, 0.7, lambda s, k, rng: _at(s, _head_m(s) + _ELSEWHERE_M)),
    "no person for 1 s of 3 s": _periodic(3.0, 1.0, lambda s, k, rng: []),
    "frozen for 1 s of 3 s": _periodic(3.0, 1.0, lambda s, k, rng: _at(s, np.array([2.0, 0.5, 0.4]))),
    "impossible heads, every other frame": lambda s, k, rng: _at(s, _head_m(s) * (1.0 if k % 2 else 1e6)),
    "each frame twice": lambda s, k, rng: [s, s],
    "flies at 8 m/s for 1 s of 4 s": _periodic(
        4.0, 1.0, lambda s, k, rng: _at(s, _head_m(s) + _TO_THE_LEFT * 8.0 * (k / _FRAME_HZ % 4.0 - 3.0))
    ),
}


def run_simulated(fault: str, walk: str) -> Count:
    """One run.

    Args:
        fault: One of `SIMULATED_FAULTS`.
        walk: A synthetic recording.

    Returns:
        The counts; deterministic.
    """
    setup = build(LiveSettings(source="replay", replay=walk, simulated_clock=True, out=Path()))
    # The source opens at time zero of the simulated clock, so its times equal the true head's.
    setup = replace(setup, source=Wrong(setup.source, "poll", _poll(SIMULATED_FAULTS[fault])))
    logs: list[Log] = []
    run = LiveRun(setup, lambda log, times: logs.append(log))
    run.run(StopEvent())
    (log,) = logs
    return Count(
        "simulated",
        f"{fault}, {walk}",
        commands=run.report.ticks,
        outside_limits=limit_violations(log, setup.neck),
        observations=run.report.observations,
        used=run.logs.used,
        refused=run.logs.refused,
        gaze_error_rms_deg=round(measure(log).gaze_error_rms_deg, 2),
    )
