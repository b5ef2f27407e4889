"""The report of one recording: what a run, or a log measured again, has to tell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.neck.spec import Axis, NeckSpec
from gazempc.recordings.recording import truth_of
from gazempc.results.figures.people import question
from gazempc.results.log import Log
from gazempc.results.metrics import SCORED_FROM_S
from gazempc.results.page.content import Page, PageTable, Unusual
from gazempc.results.page.log_charts import error_chart
from gazempc.results.page.people_tables import people_tables
from gazempc.results.repeats import Repeats
from gazempc.results.run_summary import label
from gazempc.results.table import sentence, table_lines

# Of what a run draws, in the order in which a reader wants it.
_ABOUT = {
    "overview.png": "The walk from above, the gaze error over time, and the time with eye contact",
    "gaze.gif": "Animation: what the robot sees with each gaze",
    "birds_eye.png": "The walk from above: where the person went, and where the robot looked",
    "angles.png": "Angles of the joints, and those that they should have",
    "gaze_error.png": "Gaze error over time, with the cones of eye contact",
    "attended.png": "Who was looked at over time and why, looks away, and contact",
}
# Every run begins with the first; the second is a note of the whole.
_USUAL = ("no_observation_yet", "low_frame_rate")
_TIMES_TOLD = 5


def run_page(
    logs: Mapping[str, Log],
    repeats: Sequence[Repeats],
    notes: Iterable[str],
    meanings: Mapping[str, str],
    pictures: Iterable[Path],
    command: str,
    settings: Mapping[str, Any],
) -> Page:
    """The report of a run.

    Args:
        logs: Controller -> log of the same recording, each under the first seed.
        repeats: The figures of each, in the same order.
        notes: What a reader must know.
        meanings: Event -> what it means.
        pictures: Figures and animation of the logs.
        command: What repeats the run.
        settings: All its settings.

    Returns:
        The report.
    """
    first, seeds = next(iter(logs.values())), repeats[0].seeds
    (_, names), *lines = table_lines(repeats, first.neck)
    rows = tuple((name, *cells) for name, cells in lines)
    known = any(np.isfinite(log.head_true_base_m).any() for log in logs.values())
    violations = {label(r.first.controller): sum(r.values("limit_violations")) for r in repeats}
    unusual = [Unusual(f"{name}: {n:.0f} violations of the neck's limits") for name, n in violations.items() if n]
    unusual += [Unusual(note) for note in notes]
    for name, log in logs.items():
        unusual += unusual_of(log, meanings, f"{label(name)}: " if len(logs) > 1 else "")
    return Page(
        title=f"Gaze on {first.run.recording}",
        question=question(logs),
        answer=(sentence(repeats),),
        setup=setup_of(first) | {"noise": _noise(seeds)},
        tables=(PageTable("", ("", *names), rows), *people_tables(logs)),
        charts=(error_chart(logs),) if known else (),
        pictures=captions(pictures),
        unusual=tuple(unusual),
        command=command,
        settings=settings,
    )


def setup_of(log: Log) -> dict[str, str]:
    """What a log was made with, for people.

    Args:
        log: The run.

    Returns:
        Name -> words.
    """
    run, neck, sensor = log.run, log.neck, log.run.sensor
    parts = [run.kind, f"{log.time_s[-1] - log.time_s[0]:.1f} s", run.group or "", run.subject]
    seen = [sensor["name"]]
    if "latency_s" in sensor:
        seen.append(f"{1e3 * sensor['latency_s']:.0f} ms late, {sensor['rate_hz']:g} frames a second")
    against = truth_of(run.kind) or ("the true head" if run.knows_true_head else "")
    return {
        "recording": ", ".join(part for part in (run.recording, *parts) if part),
        "sensor": ", ".join(seen),
        "neck": f"{neck.name}; {_limits(neck)}",
        "robot": f"{run.robot}, {'in simulated time' if run.mode == 'replay' else 'on a real clock'}",
        "scored": f"from {SCORED_FROM_S} s to the end, against {against}" if against else "the true head is unknown",
    }


def unusual_of(log: Log, meanings: Mapping[str, str], whose: str = "") -> list[Unusual]:
    """The events of a log, with the first traceback of each.

    Args:
        log: The run.
        meanings: Event -> what it means.
        whose: Begins each entry.

    Returns:
        One entry an event, in the order in which they came first.
    """
    faults = {fault.event: fault for fault in log.faults}
    found = []
    for event in dict.fromkeys([*log.event_name.tolist(), *faults]):
        if event in _USUAL:
            continue
        times_s = log.event_time_s[log.event_name == event] - log.time_s[0]
        fault = faults.get(event)
        times = f"{fault.count if fault else times_s.size} x"
        each = ", ".join(f"{time_s:.2f}" for time_s in times_s[:_TIMES_TOLD])
        when = f" at {each}{', ...' if times_s.size > _TIMES_TOLD else ''} s" if times_s.size else ""
        text = ": ".join(filter(None, (meanings.get(event, ""), fault.error if fault else "")))
        found.append(Unusual(f"{whose}{event}, {times}{when}", text, fault.traceback if fault else ""))
    return found


def captions(pictures: Iterable[Path]) -> dict[Path, str]:
    """Pictures of a run in reading order, with what each shows; others come last, with their file's name."""
    by_name = {path.name: path for path in pictures}
    about = {name: _ABOUT[name] for name in _ABOUT if name in by_name}
    about |= {name: path.stem.replace("_", " ") for name, path in by_name.items() if name not in _ABOUT}
    return {by_name[name]: words for name, words in about.items()}


def _noise(seeds: Sequence[int]) -> str:
    if len(seeds) == 1:
        return f"one seed, {seeds[0]}"
    return (
        f"seeds {seeds[0]} to {seeds[-1]}: mean ± standard deviation over them; peaks: highest of all; curves and "
        f"pictures: seed {seeds[0]}"
    )


def _limits(neck: NeckSpec) -> str:
    """Dead time, range and limits, joint by joint; joints that are alike but for their range together."""
    alike: dict[str, list[str]] = {}
    for name, axis in zip(neck.joint_names, neck.axes, strict=True):
        span = f"{name.replace('_', ' ')} {axis.position_min_deg:g} to {axis.position_max_deg:g} deg"
        alike.setdefault(_servo(axis), []).append(span)
    return "; ".join(f"{', '.join(spans)}: {servo}" for servo, spans in alike.items())


def _servo(axis: Axis) -> str:
    return (
        f"dead time {axis.dead_time_s:g} s, servo lag {axis.servo_lag_s:.2g} s, at most {axis.velocity_max_rad_s:g} "
        f"rad/s, {axis.acceleration_max_rad_s2:g} rad/s², {axis.jerk_max_rad_s3:g} rad/s³"
    )
