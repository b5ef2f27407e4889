"""Figures of a run: metrics, computing times, caught exceptions, and `summary.json`."""

from __future__ import annotations

import json
import math
import platform
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.files.whole import write_whole
from gazempc.parts import TRUE_FUTURE
from gazempc.results.contact import of_known
from gazempc.results.log import ComputeTimes
from gazempc.results.metrics import Metrics, gap_closed


@dataclass(frozen=True)
class ComputeMetrics:
    """Computing times; they differ from run to run.

    Attributes:
        update_ms_p50: Median predictor update, milliseconds.
        update_ms_p99: 99th percentile.
        update_ms_max: Longest.
        step_ms_p50: Median controller step (forecast and plan), milliseconds.
        step_ms_p99: 99th percentile.
        step_ms_max: Longest.
        missed_deadlines: Steps that took longer than a control period.
    """

    update_ms_p50: float
    update_ms_p99: float
    update_ms_max: float
    step_ms_p50: float
    step_ms_p99: float
    step_ms_max: float
    missed_deadlines: int


def measure_compute(times: ComputeTimes, control_period_s: float) -> ComputeMetrics:
    """Summarise compute times.

    Args:
        times: Times measured by the loop.
        control_period_s: Deadline of a step, seconds.

    Returns:
        The metrics; NaN where nothing was measured.
    """
    figures = {
        f"{name}_ms_{quantile}": of_known(values_ms, partial(np.percentile, q=q))
        for name, values_ms in (("update", times.update_ms), ("step", times.step_ms))
        for quantile, q in (("p50", 50), ("p99", 99), ("max", 100))
    }
    return ComputeMetrics(**figures, missed_deadlines=int(np.sum(times.step_ms > 1e3 * control_period_s)))


LABELS = {
    "reactive": "reactive",
    "lookahead": "look-ahead",
    "mpc": "MPC",
    TRUE_FUTURE: "MPC with perfect forecast",
}
_PACKAGES = ("gazempc", "daqp", "numpy", "scipy", "filterpy", "ruckig", "matplotlib", "pydantic")


def label(controller: str) -> str:
    """Display name of a controller; a user-defined one keeps its name."""
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
        """The row in the format of `summary.json`."""
        names = {"controller": self.controller, "predictor": self.predictor}
        return {**names, **vars(self.metrics), "gap_closed": self.gap_closed, **vars(self.compute)}


def make_rows(results: list[tuple[str, str, Metrics, ComputeMetrics]]) -> list[Row]:
    """Add to each controller the closed share of the gap to perfect foresight.

    Args:
        results: Controller, predictor and figures of each run on one recording.

    Returns:
        The rows; gap closed is NaN unless both ``reactive`` and ``mpc+perfect`` are among them.
    """
    rms = {controller: metrics.gaze_error_rms_deg for controller, _, metrics, _ in results}
    reactive, perfect = rms.get("reactive", math.nan), rms.get(TRUE_FUTURE, math.nan)
    return [
        Row(controller, predictor, metrics, compute, gap_closed(metrics.gaze_error_rms_deg, reactive, perfect))
        for controller, predictor, metrics, compute in results
    ]


def versions() -> dict[str, str]:
    """Versions of the software that computed the figures.

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
        about: Content before the rows, such as recording and settings.
        rows: The figures; NaN becomes null, as JSON has no NaN.
    """
    content = {**about, "versions": versions(), "rows": [row.as_dict() for row in rows]}
    write_whole(path, json.dumps(without_nan(content), indent=2) + "\n")


def without_nan(value: Any) -> Any:
    """A value with None in place of NaN and infinity, which JSON lacks."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
