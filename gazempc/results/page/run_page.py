"""Reports of a replayed recording, of a re-evaluated log, and of a live run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.neck.spec import NeckSpec
from gazempc.recordings.recording import truth_of
from gazempc.results.attention import WORDS, measure_attention
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures import people
from gazempc.results.figures.style import COLOURS, styles
from gazempc.results.log import Fault, Log
from gazempc.results.metrics import SCORED_FROM_S, gaze_error_deg
from gazempc.results.page.content import Chart, Curve, Page, PageTable, Span, Unusual
from gazempc.results.run_summary import label
from gazempc.results.table import Repeats, sentence, table_lines


def error_chart(logs: Mapping[str, Log]) -> Chart:
    """The gaze error of each controller over time.

    Args:
        logs: Controller -> log of the same recording.

    Returns:
        The chart; curves have gaps where the true head or the joints are not known.
    """
    looks = styles(logs)
    curves = tuple(
        Curve(looks[name].label, looks[name].colour, log.time_s - log.time_s[0], gaze_error_deg(log))
        for name, log in logs.items()
    )
    levels = ((CONTACT_DEG[0], f"eye contact, {CONTACT_DEG[0]:g}°"),)
    spans = (Span(0.0, SCORED_FROM_S, "not scored"), *_people(logs))
    return Chart("Gaze error over time", "time (s)", "gaze error (deg)", curves, levels, spans)


def _people(logs: Mapping[str, Log]) -> Iterator[Span]:
    """Intervals of gaze aversion, and the attended people, where these are equal in all runs."""
    yield from (Span(from_s, to_s, "looks away") for from_s, to_s in people.away_in_all(logs))
    if any(log.attended_time_s.size for log in logs.values()) and people.are_alike(logs):
        for turn in people.turns(next(iter(logs.values()))):
            yield Span(turn.from_s, turn.to_s, turn.texts[0], people.person_colour(turn.number))


def joints_chart(log: Log) -> Chart:
    """Joint angles over time, for runs with an unknown gaze error.

    Args:
        log: The run.

    Returns:
        The chart.
    """
    time_s, angles_deg = log.time_s - log.time_s[0], np.rad2deg(log.joint_position_rad)
    curves = tuple(
        Curve(name.replace("_", " "), colour, time_s, angles_deg[:, k])
        for k, (name, colour) in enumerate(zip(log.neck.joint_names, COLOURS, strict=False))
    )
    spans = tuple(_people({log.run.controller: log}))
    return Chart("Joints over time", "time (s)", "angle (deg)", curves, spans=spans)


def people_tables(logs: Mapping[str, Log]) -> tuple[PageTable, ...]:
    """Attended people, and metrics of attention.

    Args:
        logs: Controller -> log of the same recording.

    Returns:
        The metrics, and the time line of the last run; empty for one person without gaze aversion.
    """
    if not people.has_attention(logs):
        return ()
    found = [vars(measure_attention(log)) for log in logs.values()]
    known = [name for name in WORDS if any(np.isfinite(each[name]) for each in found)]
    shown = {name: [f"{WORDS[name][1] * each[name]:.3g}".replace("nan", "-") for each in found] for name in known}
    rows = tuple((WORDS[name][0], *cells) for name, cells in shown.items())
    of_each = PageTable("People and looks away", ("", *map(label, logs)), rows)
    name, log = list(logs.items())[-1]
    attended = [(turn.from_s, turn.to_s, turn.texts[0]) for turn in people.turns(log)]
    away = [(from_s, to_s, f"looks away: {why}") for from_s, to_s, why in people.looks_away(log)]
    lines = tuple((f"{from_s:.2f}", f"{to_s:.2f}", what) for from_s, to_s, what in sorted(attended + away))
    return of_each, PageTable(f"Attended person: {label(name)}", ("from [s]", "to [s]", ""), lines)


# Pictures of a run, in reading order.
_ABOUT = {
    "overview.png": "The walk from above, the gaze error over time, and the time with eye contact",
    "gaze.gif": "Animation of the robot's view with each gaze",
    "angles.png": "Angles of joints, commands and person over time",
    "attended.png": "The attended person over time with the reason, looks away, and contact",
}
# Omitted: the first begins every run; the second is a note on the whole run.
_USUAL = ("no_observation_yet", "low_frame_rate")
_TIMES_LISTED = 5


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
        repeats: Figures of each controller over the seeds, in the same order.
        notes: Notes for the reader.
        meanings: Event -> its meaning.
        pictures: Figures and animation of the logs.
        command: Command line that reproduces the run.
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
    noise = f"one seed, {seeds[0]}"
    if len(seeds) > 1:
        over = "mean ± standard deviation over them; peaks: highest of all; curves and pictures"
        noise = f"seeds {seeds[0]} to {seeds[-1]}: {over}: seed {seeds[0]}"
    return Page(
        title=f"Gaze on {first.run.recording}",
        question=people.question(logs),
        answer=(sentence(repeats),),
        setup=setup_of(first) | {"noise": noise},
        tables=(PageTable("", ("", *names), rows), *people_tables(logs)),
        charts=(error_chart(logs),) if known else (),
        pictures=captions(pictures),
        unusual=tuple(unusual),
        command=command,
        settings=settings,
    )


def setup_of(log: Log) -> dict[str, str]:
    """Set-up of a log, for the reader.

    Args:
        log: The run.

    Returns:
        Name -> description.
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
        meanings: Event -> its meaning.
        whose: Prefix of each entry.

    Returns:
        One entry per event, in order of first occurrence.
    """
    faults = {fault.event: fault for fault in log.faults}
    found = []
    for event in dict.fromkeys([*log.event_name.tolist(), *faults]):
        if event in _USUAL:
            continue
        times_s = log.event_time_s[log.event_name == event] - log.time_s[0]
        each = ", ".join(f"{time_s:.2f}" for time_s in times_s[:_TIMES_LISTED])
        when = f" at {each}{', ...' if times_s.size > _TIMES_LISTED else ''} s" if times_s.size else ""
        found.append(_of_event(faults.get(event, Fault(event, times_s.size, "", "")), meanings, whose, when))
    return found


def _of_event(fault: Fault, meanings: Mapping[str, str], whose: str = "", when: str = "") -> Unusual:
    """An event, with its first exception, if any."""
    text = ": ".join(filter(None, (meanings.get(fault.event, ""), fault.error)))
    return Unusual(f"{whose}{fault.event}, {fault.count} x{when}", text, fault.traceback)


def captions(pictures: Iterable[Path]) -> dict[Path, str]:
    """Pictures of a run in reading order, with captions; others last, with their file names."""
    by_name = {path.name: path for path in pictures}
    others = {name: path.stem.replace("_", " ") for name, path in by_name.items()}
    return {by_name[name]: words for name, words in (_ABOUT | others | _ABOUT).items() if name in by_name}


def _limits(neck: NeckSpec) -> str:
    """Range, dead time and limits of each joint."""
    return "; ".join(
        f"{name.replace('_', ' ')} {axis.position_min_deg:g} to {axis.position_max_deg:g} deg, dead time "
        f"{axis.dead_time_s:g} s, servo lag {axis.servo_lag_s:.2g} s, at most {axis.velocity_max_rad_s:g} rad/s, "
        f"{axis.acceleration_max_rad_s2:g} rad/s², {axis.jerk_max_rad_s3:g} rad/s³"
        for name, axis in zip(neck.joint_names, neck.axes, strict=True)
    )


def live_page(
    summary: Mapping[str, Any], log: Log, meanings: Mapping[str, str], pictures: Iterable[Path], command: str
) -> Page:
    """The report of a live run.

    Args:
        summary: Content of `summary.json`.
        log: The last log.
        meanings: Event -> its meaning.
        pictures: Figures of the last log.
        command: Command line that reproduces the run.

    Returns:
        The report.
    """
    names, metrics = summary["logs"], summary["metrics_of_last_log"]
    known = bool(np.isfinite(log.head_true_base_m).any())
    of_log = f"{names[-1]}, the last of {len(names)} logs" if len(names) > 1 else names[-1]
    answer = "The gaze error is unknown, as the true head is unknown."
    if metrics is not None and metrics["gaze_error_rms_deg"] is not None:
        answer = (
            f"The gaze was on the person's eyes (within 2.6 deg) {100 * metrics['eye_contact_2p6']:.1f} % of the time, "
            f"at an RMS error of {metrics['gaze_error_rms_deg']:.2f} deg, against {summary['scored_against']}."
        )
    logs = {log.run.controller: log}
    figures = (metrics or {}) | (summary["compute_of_last_log"] or {})
    rows = tuple((name, f"{value:.4g}") for name, value in figures.items() if value is not None)
    whole_run = PageTable("The whole run", ("", "value"), tuple(_live_rows(summary)))
    of_last_log = PageTable(f"Metrics of {of_log}", ("", "value"), rows)
    return Page(
        title=f"Live gaze from {log.run.recording}",
        question=people.question(logs),
        answer=(answer,),
        setup=setup_of(log) | {"gaze": f"{log.run.controller}, predictor {log.run.predictor}", "log": of_log},
        tables=(whole_run, of_last_log, *people_tables(logs)),
        charts=(error_chart(logs) if known else joints_chart(log),),
        pictures=captions(pictures),
        unusual=tuple(_live_unusual(summary, meanings)),
        command=command,
        settings=summary["settings"],
    )


def _live_rows(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    late, latency = summary["lateness_ms"], summary["end_to_end_latency_ms"]
    yield from (("stopped by", summary["stopped_by"]), ("ticks", str(summary["ticks"])))
    yield " skipped", str(summary["skipped_ticks"])
    yield from ((f" later than due, {name} [ms]", f"{late[name]:.2f}") for name in ("p50", "p99", "max"))
    yield from (("observations", str(summary["observations"])), (" used", str(summary["used"])))
    yield from ((f" refused: {name}", str(count)) for name, count in summary["refused"].items())
    if latency["p50"] is not None:
        yield from ((f"from capture to command, {name} [ms]", f"{latency[name]:.0f}") for name in ("p50", "p99"))
    yield "limit violations", str(summary["limit_violations"])


def _live_unusual(summary: Mapping[str, Any], meanings: Mapping[str, str]) -> Iterator[Unusual]:
    if summary["limit_violations"]:
        yield Unusual(f"{summary['limit_violations']} violations of the neck's limits")
    yield from (Unusual(f"warning: {warning}") for warning in summary["warnings"])
    events = {event: Fault(event, count, "", "") for event, count in summary["events"].items()}
    events |= {fault["event"]: Fault(**fault) for fault in summary["faults"]}
    yield from (_of_event(event, meanings) for event in events.values())
    yield from (Unusual(f"not used: {problem}") for problem in summary["problems"])
