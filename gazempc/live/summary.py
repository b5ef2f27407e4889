"""Output of a live run: logs on disk, `summary.json`, report and text summary."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gazempc.errors import LeftOutError
from gazempc.files.whole import write_whole
from gazempc.live.logs import Lateness
from gazempc.live.run import LiveRun
from gazempc.live.settings import LiveSettings
from gazempc.live.stamps import shown
from gazempc.loop.events import MEANINGS, Event
from gazempc.neck.spec import NeckSpec
from gazempc.recordings.recording import truth_of
from gazempc.results.log import ComputeTimes, Fault, Log
from gazempc.results.metrics import measure
from gazempc.results.motion import limit_violations
from gazempc.results.run_summary import measure_compute, versions, without_nan

_LATE_MS = 1.0
_SHOWN_PROBLEMS = 5
# Above the difference of clocks in any two time zones.
_OTHER_CLOCK_S = 14 * 3600.0
# Short reasons of refused observations, by event.
_REASONS = {
    Event.STALE_OBSERVATION: "stale",
    Event.FUTURE_OBSERVATION: "future",
    Event.OUT_OF_ORDER: "out of order",
    Event.GATE_REFUSED: "gate",
    Event.IMPLAUSIBLE_PERSON: "implausible",
    Event.SENDER_REFUSED: "sender",
    Event.BAD_OBSERVATION: "unreadable",
    Event.OBSERVATIONS_DROPPED: "too many",
    Event.TRACKER_FROZEN: "frozen",
    Event.FORECAST_FAILED: "predictor failed",
}


class KeptLogs:
    """Writes each log of a run, and collects the data of the summary.

    Args:
        settings: Settings of the run; `out` is the output folder.
        neck: The neck.
        on_kept: Called with the path of each complete log.

    Attributes:
        names: Names of the logs written so far.
        files: The same, with the files of computing times.
        violations: Violations of the neck's limits in them.
    """

    def __init__(self, settings: LiveSettings, neck: NeckSpec, on_kept: Callable[[Path], None] | None = None) -> None:
        self._settings, self._neck = settings, neck
        self._on_kept = on_kept or (lambda _: None)
        self._last: tuple[Log, ComputeTimes] | None = None
        self._latency = Lateness()
        self.names: list[str] = []
        self.files: list[str] = []
        self.violations = 0

    def keep(self, log: Log, times: ComputeTimes) -> None:
        """Write a complete log."""
        name, compute = (f"{kind}_{len(self.names):03}.npz" for kind in ("log", "compute"))
        log.save(self._settings.out / name)
        times.save(self._settings.out / compute)
        self.names.append(name)
        self.files += [name, compute]
        self._on_kept(self._settings.out / name)
        self._last = log, times
        for latency_ms in times.latency_ms:
            self._latency.add(float(latency_ms))
        if log.time_s.size > 3:
            self.violations += limit_violations(log, self._neck)

    def write(self, run: LiveRun) -> dict[str, Any]:
        """Write `summary.json`.

        Args:
            run: The run, ended.

        Returns:
            Its content.
        """
        report, late, latency = run.report, run.report.lateness, self._latency
        ages_s = report.least_age_s, report.greatest_age_s
        kind, metrics, compute = "", None, None
        if self._last is not None:
            log, times = self._last
            kind, compute = log.run.kind, without_nan(vars(measure_compute(times, self._neck.control_period_s)))
            with suppress(LeftOutError, ValueError):  # too short to be scored, or truncated by a fault
                metrics = without_nan(measure(log).as_dict())
        summary = {
            "stopped_by": report.stopped_by,
            "ticks": report.ticks,
            "skipped_ticks": report.skipped_ticks,
            "lateness_ms": {"p50": late.percentile_ms(50), "p99": late.percentile_ms(99), "max": late.max_ms},
            "late_ticks": late.beyond(_LATE_MS),
            "end_to_end_latency_ms": {
                f"p{share}": latency.percentile_ms(share) if latency.count else None for share in (50, 99)
            },
            "observations": report.observations,
            "used": run.logs.used,
            "refused": run.logs.refused,
            "soonest_age_s": [age_s if math.isfinite(age_s) else None for age_s in ages_s],
            "warnings": report.warnings,
            "problems": report.problems,
            "events": run.logs.events,
            "faults": [asdict(fault) for fault in run.logs.faults],
            "limit_violations": self.violations,
            "scored_against": truth_of(kind) or "the recording's true head",
            "metrics_of_last_log": metrics,
            "compute_of_last_log": compute,
            "logs": self.names,
            "settings": self._settings.model_dump(mode="json"),
            "versions": versions(),
        }
        write_whole(self._settings.out / "summary.json", json.dumps(summary, indent=2) + "\n")
        return summary

    def report(self, summary: dict[str, Any], command: str) -> list[str]:
        """Draw the last log, and write the report of the run.

        Args:
            summary: Result of `write`.
            command: Command line that reproduces the run.

        Returns:
            Names of the files; empty without a log.
        """
        from gazempc.results.page.run_page import live_page  # noqa: PLC0415  (slow to import)
        from gazempc.results.page.write import write_page  # noqa: PLC0415

        if self._last is None:
            return []
        log, out, figures = self._last[0], self._settings.out, list[Path]()
        if self._settings.figures and log.time_s.size >= 2:
            # Local import: Matplotlib takes a second to import.
            from gazempc.results.figures.angles import angles  # noqa: PLC0415
            from gazempc.results.figures.overview import attended  # noqa: PLC0415
            from gazempc.results.figures.people import has_attention  # noqa: PLC0415

            logs: dict[str, Log] = {log.run.controller: log}
            for draw in (angles, attended) if has_attention(logs) else (angles,):
                figures.append(out / f"{draw.__name__}.png")
                draw(logs, figures[-1])
        page = write_page(live_page(summary, log, MEANINGS, figures, command), out)
        return [page, *(figure.name for figure in figures)]


def text(summary: dict[str, Any]) -> str:
    """The summary as text.

    Args:
        summary: Result of `KeptLogs.write`.

    Returns:
        Lines of text.
    """
    late, latency = summary["lateness_ms"], summary["end_to_end_latency_ms"]
    lines = [
        f"stopped by: {summary['stopped_by']}",
        f"{summary['ticks']} ticks, {summary['skipped_ticks']} skipped; later than due by {late['p50']:.2f} ms (p50), "
        f"{late['p99']:.2f} ms (p99), {late['max']:.2f} ms (max)",
    ]
    if latency["p50"] is not None:
        lines.append(f"from capture to command: {latency['p50']:.0f} ms (p50), {latency['p99']:.0f} ms (p99)")
    metrics = summary["metrics_of_last_log"]
    if metrics is not None and metrics["gaze_error_rms_deg"] is not None:
        lines.append(
            f"gaze error {metrics['gaze_error_rms_deg']:.2f} deg RMS, eye contact (2.6 deg) "
            f"{100 * metrics['eye_contact_2p6']:.0f} %, against {summary['scored_against']}"
        )
    lines += [f"WARNING {warning}" for warning in summary["warnings"]]
    lines.append(f"limit violations: {summary['limit_violations']}")
    faults = [Fault(**fault) for fault in summary["faults"]]
    with_text = {fault.event for fault in faults}
    lines += [f"  {name} {count} x" for name, count in summary["events"].items() if name not in with_text]
    lines += [f"  {fault.line}" for fault in faults]
    lines += [f"  {problem}" for problem in summary["problems"][:_SHOWN_PROBLEMS]]
    return "\n".join(lines)


def last_line(summary: dict[str, Any]) -> str:
    """Last line of a run: number of used observations, and reasons of the others.

    Args:
        summary: Result of `KeptLogs.write`.

    Returns:
        Such as ``0 of 360 used: 360 future (clock 0.1 s ahead?)``.
    """
    reasons = [
        f"{count} {_REASONS.get(name, name)}{_clock_hint(name, summary)}" for name, count in summary["refused"].items()
    ]
    counts = f"{summary['used']} of {summary['observations']} used"
    return f"{counts}: {', '.join(reasons)}" if reasons else counts


def _clock_hint(name: str, summary: dict[str, Any]) -> str:
    """Possible offset of the tracker's clock, if it explains the refused observations."""
    least_s, greatest_s = summary["soonest_age_s"]
    off_s = 0.0
    if name == Event.FUTURE_OBSERVATION and least_s is not None and least_s < 0:
        off_s = summary["settings"]["stamps"]["latency_s"] - least_s
    if name == Event.STALE_OBSERVATION and greatest_s is not None:
        off_s = -greatest_s
    if abs(off_s) > _OTHER_CLOCK_S:
        return " (another clock, or another unit?)"
    off = f"{abs(off_s):.1g}" if abs(off_s) < 1 else shown(abs(off_s))
    return (f" (clock {off} s ahead?)" if off_s > 0 else f" (clock {off} s behind, or slow?)") if off_s else ""
