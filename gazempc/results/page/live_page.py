"""The report of a live run, from its `summary.json` and its last log."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.results.figures.people import question
from gazempc.results.log import Log
from gazempc.results.page.content import Page, PageTable, Unusual
from gazempc.results.page.log_charts import error_chart, joints_chart
from gazempc.results.page.people_tables import people_tables
from gazempc.results.page.run_page import captions, setup_of

_UNKNOWN = "The true head is unknown, so the gaze error is unknown, too."


def live_page(
    summary: Mapping[str, Any], log: Log, meanings: Mapping[str, str], pictures: Iterable[Path], command: str
) -> Page:
    """The report of a live run.

    Args:
        summary: What stands in `summary.json`.
        log: The last log.
        meanings: Event -> what it means.
        pictures: Figures of the last log.
        command: What repeats the run.

    Returns:
        The report.
    """
    names, metrics = summary["logs"], summary["metrics_of_last_log"]
    known = bool(np.isfinite(log.head_true_base_m).any())
    of_log = f"{names[-1]}, the last of {len(names)} logs" if len(names) > 1 else names[-1]
    answer = _UNKNOWN
    if metrics is not None and metrics["gaze_error_rms_deg"] is not None:
        answer = (
            f"The gaze was on the person's eyes (within 2.6 deg) {100 * metrics['eye_contact_2p6']:.1f} % of the time, "
            f"at an RMS error of {metrics['gaze_error_rms_deg']:.2f} deg, against {summary['scored_against']}."
        )
    chart = error_chart({log.run.controller: log}) if known else joints_chart(log)
    return Page(
        title=f"Live gaze from {log.run.recording}",
        question=question({log.run.controller: log}),
        answer=(answer,),
        setup=setup_of(log) | {"gaze": f"{log.run.controller}, predictor {log.run.predictor}", "log": of_log},
        tables=(*_tables(summary, of_log), *people_tables({log.run.controller: log})),
        charts=(chart,),
        pictures=captions(pictures),
        unusual=tuple(_unusual(summary, meanings)),
        command=command,
        settings=summary["settings"],
    )


def _tables(summary: Mapping[str, Any], of_log: str) -> tuple[PageTable, ...]:
    known = (summary["metrics_of_last_log"] or {}) | (summary["compute_of_last_log"] or {})
    rows = [(name, f"{value:.4g}") for name, value in known.items() if value is not None]
    metrics = [PageTable(f"Metrics of {of_log}", ("", "value"), tuple(rows))] if rows else []
    return PageTable("The whole run", ("", "value"), tuple(_rows(summary))), *metrics


def _rows(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    late, latency = summary["lateness_ms"], summary["end_to_end_latency_ms"]
    yield "stopped by", summary["stopped_by"]
    yield "ticks", str(summary["ticks"])
    yield " skipped", str(summary["skipped_ticks"])
    yield from ((f" later than due, {name} [ms]", f"{late[name]:.2f}") for name in ("p50", "p99", "max"))
    yield "observations", str(summary["observations"])
    yield " used", str(summary["used"])
    yield from ((f" refused: {name}", str(count)) for name, count in summary["refused"].items())
    if latency["p50"] is not None:
        yield from ((f"from capture to command, {name} [ms]", f"{latency[name]:.0f}") for name in ("p50", "p99"))
    yield "limit violations", str(summary["limit_violations"])


def _unusual(summary: Mapping[str, Any], meanings: Mapping[str, str]) -> Iterator[Unusual]:
    if summary["limit_violations"]:
        yield Unusual(f"{summary['limit_violations']} violations of the neck's limits")
    yield from (Unusual(f"warning: {warning}") for warning in summary["warnings"])
    faults = {fault["event"]: fault for fault in summary["faults"]}
    for event in dict.fromkeys([*summary["events"], *faults]):
        fault = faults.get(event)
        count = fault["count"] if fault else summary["events"][event]
        text = ": ".join(filter(None, (meanings.get(event, ""), fault["error"] if fault else "")))
        yield Unusual(f"{event}, {count} x", text, fault["traceback"] if fault else "")
    yield from (Unusual(f"not used: {problem}") for problem in summary["problems"])
