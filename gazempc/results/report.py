"""What a run tells people: a table, one sentence, and `summary.json`."""

from __future__ import annotations

import json
import math
import platform
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from gazempc.neck.spec import NeckSpec
from gazempc.results.compute import ComputeMetrics
from gazempc.results.log import Log
from gazempc.results.metrics import Metrics, gap_closed

LABELS = {
    "reactive": "reactive",
    "lookahead": "look-ahead",
    "mpc": "MPC",
    "perfect": "MPC with perfect forecast",
}
_PACKAGES = ("gazempc", "casadi", "numpy", "scipy", "filterpy", "ruckig", "control", "matplotlib", "pydantic")


def label(controller: str) -> str:
    """Name of a controller for people; one of the user's own keeps its name."""
    return LABELS.get(controller, controller)


@dataclass(frozen=True)
class Row:
    """Figures of one controller on one recording."""

    controller: str
    predictor: str
    metrics: Metrics
    compute: ComputeMetrics
    gap_closed: float

    def as_dict(self) -> dict[str, Any]:
        """The row as it stands in `summary.json`."""
        return {
            "controller": self.controller,
            "predictor": self.predictor,
            **self.metrics.as_dict(),
            "gap_closed": self.gap_closed,
            **self.compute.as_dict(),
        }


def make_rows(results: list[tuple[str, str, Metrics, ComputeMetrics]]) -> list[Row]:
    """Add to each controller how much of the gap to perfect foresight it closes.

    Args:
        results: Controller, predictor and figures of each run on one recording.

    Returns:
        The rows; gap closed is NaN unless both ``reactive`` and ``perfect`` are among them.
    """
    rms = {controller: metrics.gaze_error_rms_deg for controller, _, metrics, _ in results}
    reactive, perfect = rms.get("reactive", math.nan), rms.get("perfect", math.nan)
    return [
        Row(controller, predictor, metrics, compute, gap_closed(metrics.gaze_error_rms_deg, reactive, perfect))
        for controller, predictor, metrics, compute in results
    ]


def table(rows: list[Row], neck: NeckSpec) -> str:
    """A readable table, one controller a column.

    Args:
        rows: The figures.
        neck: Its limits stand beside the peaks.

    Returns:
        Lines of text.
    """

    def limit(values: Any) -> str:
        low, high = min(values), max(values)
        return f"{high:g}" if low == high else f"{low:g}/{high:g}"

    lines: list[tuple[str, list[str]]] = [
        ("", [label(row.controller) for row in rows]),
        ("filter and forecast", [row.predictor for row in rows]),
        ("gaze error RMS [deg]", [f"{row.metrics.gaze_error_rms_deg:.2f}" for row in rows]),
        ("           median [deg]", [f"{row.metrics.gaze_error_median_deg:.2f}" for row in rows]),
        ("           95 % below [deg]", [f"{row.metrics.gaze_error_p95_deg:.2f}" for row in rows]),
        ("eye contact within 2.6 deg", [_share(row.metrics.eye_contact_2p6) for row in rows]),
        ("            within 4 deg", [_share(row.metrics.eye_contact_4) for row in rows]),
        ("            within 9 deg", [_share(row.metrics.eye_contact_9) for row in rows]),
        ("gap to perfect closed", [_share(row.gap_closed) for row in rows]),
        ("RMS acceleration [rad/s^2]", [f"{row.metrics.rms_acceleration_rad_s2:.2f}" for row in rows]),
        (
            f"peak velocity [rad/s], limit {limit(neck.velocity_max_rad_s)}",
            [f"{row.metrics.peak_velocity_rad_s:.2f}" for row in rows],
        ),
        (
            f"peak acceleration [rad/s^2], limit {limit(neck.acceleration_max_rad_s2)}",
            [f"{row.metrics.peak_acceleration_rad_s2:.1f}" for row in rows],
        ),
        (
            f"peak jerk [rad/s^3], limit {limit(neck.jerk_max_rad_s3)}",
            [f"{row.metrics.peak_jerk_rad_s3:.0f}" for row in rows],
        ),
        ("limit violations", [str(row.metrics.limit_violations) for row in rows]),
        ("step time, median [ms]", [f"{row.compute.step_ms_p50:.2f}" for row in rows]),
        ("           99 % below [ms]", [f"{row.compute.step_ms_p99:.2f}" for row in rows]),
    ]
    first = max(len(label) for label, _ in lines)
    widths = [max(len(cells[i]) for _, cells in lines) for i in range(len(rows))]
    text = [
        f"{label:<{first}}  " + "  ".join(f"{cell:>{w}}" for cell, w in zip(cells, widths, strict=True))
        for label, cells in lines
    ]
    text.insert(2, "-" * len(text[0]))
    return "\n".join(line.rstrip() for line in text)


def sentence(rows: list[Row]) -> str:
    """One sentence that says what the table means.

    Args:
        rows: The figures.

    Returns:
        The sentence; it compares what is there with the reactive gaze and the perfect forecast.
    """
    by_name = {row.controller: row for row in rows}
    predictive = [by_name[name] for name in ("lookahead", "mpc") if name in by_name]
    if "reactive" not in by_name or not predictive:
        best = min(rows, key=lambda row: row.metrics.gaze_error_rms_deg)
        return (
            f"The {label(best.controller)} gaze is on the person's eyes (within 2.6 deg) "
            f"{_share(best.metrics.eye_contact_2p6)} of the time."
        )
    reactive = by_name["reactive"].metrics
    claims = []
    for row in predictive:
        ratio = reactive.gaze_error_rms_deg / row.metrics.gaze_error_rms_deg
        change = f"{ratio:.1f} times smaller" if ratio > 1 else f"{1 / ratio:.1f} times larger"
        claims.append(f"{label(row.controller)} {_share(row.metrics.eye_contact_2p6)} (RMS error {change})")
    text = (
        f"A gaze that only reacts is on the person's eyes (within 2.6 deg) "
        f"{_share(reactive.eye_contact_2p6)} of the time, {' and '.join(claims)}"
    )
    if "perfect" in by_name:
        limit = by_name["perfect"].metrics
        text += (
            f"; with perfect foresight the same neck could reach {_share(limit.eye_contact_2p6)} "
            f"at {limit.gaze_error_rms_deg:.2f} deg"
        )
    return text + "."


def faults(log: Log) -> list[dict[str, Any]]:
    """The exceptions that a run survived, as they stand in `summary.json`.

    Args:
        log: The run.

    Returns:
        For each event its name, how often it came, the first exception and its traceback.
    """
    return [asdict(fault) for fault in log.faults]


def fault_lines(log: Log) -> list[str]:
    """The same for people, one line each, such as ``forecast_failed (412 x): TypeError: ...``."""
    return [fault.line for fault in log.faults]


def versions() -> dict[str, str]:
    """Versions of what made the figures.

    Returns:
        Python, platform and packages.
    """
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def write_summary(path: Path, about: dict[str, Any], rows: list[Row]) -> None:
    """Write `summary.json`.

    Args:
        path: File to write.
        about: What stands before the rows, such as recording and settings.
        rows: The figures; NaN becomes null, as JSON has no NaN.
    """
    content = {**about, "versions": versions(), "rows": [row.as_dict() for row in rows]}
    path.write_text(json.dumps(_without_nan(content), indent=2) + "\n", encoding="utf-8")


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _share(value: float) -> str:
    return "-" if math.isnan(value) else f"{100 * value:.1f} %"
