"""Selection of clips, and means over clips with bootstrap confidence intervals over people."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from gazempc.parts import TRUE_FUTURE
from gazempc.recordings.readers.labels import ROUTES, STANDING
from gazempc.results.metrics import Metrics
from gazempc.results.run_summary import ComputeMetrics

GROUP_ORDER = (STANDING, *ROUTES)
# Order of the kinds of activity in tables; other kinds follow.
KIND_ORDER = ("moving", "starting", "stopping", "waiting", "standing", "sitting", "gesturing", "turning on the spot")


@dataclass(frozen=True)
class Clips:
    """Selection of clips for a row of a table: one group, one kind, or all."""

    group: str = "all"
    kind: str = "all"

    def hold(self, row: Mapping[str, Any]) -> bool:
        """Whether the selection contains a run, by its ``group`` and ``kind``."""
        return self.group in {"all", row["group"]} and self.kind in {"all", row["kind"]}


def groups_of(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Groups in the order of tables, ``all`` last."""
    return [*_in_order((row["group"] for row in rows), GROUP_ORDER), "all"]


def clips_of(rows: Iterable[Mapping[str, Any]]) -> list[Clips]:
    """Selections for the rows of a table: each group, each kind, then all.

    Args:
        rows: Runs with ``group`` and ``kind``, None if unknown.

    Returns:
        The selections, in the order of tables.
    """
    rows = list(rows)
    groups = _in_order((row["group"] for row in rows), GROUP_ORDER)
    kinds = _in_order((row["kind"] for row in rows), KIND_ORDER)
    return [*(Clips(group=group) for group in groups), *(Clips(kind=kind) for kind in kinds), Clips()]


def _in_order(names: Iterable[str | None], order: Sequence[str]) -> list[str]:
    found = {name for name in names if name}
    known = [name for name in order if name in found]
    return [*known, *sorted(found - set(known))]


def grouped(rows: Iterable[Mapping[str, Any]], *names: str) -> dict[tuple[Any, ...], list[Any]]:
    """Rows by their values in some columns, in order of first occurrence."""
    found: dict[tuple[Any, ...], list[Any]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in names), []).append(row)
    return found


def sensors_of(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Sensors in order of first occurrence."""
    return list(dict.fromkeys(row["sensor"] for row in rows))


def file_name(figure: str, *parts: str) -> str:
    """Name of a PNG file from the figure's name and further parts, such as a sensor."""
    file_name = "_".join([figure, *parts])
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in file_name) + ".png"


# Machine-dependent metrics, and all metrics of a run.
TIMING = tuple(f.name for f in fields(ComputeMetrics))
METRICS = (*(f.name for f in fields(Metrics)), *TIMING)
# Metrics of the paired comparison: name, label in the report, digits. All except the first refer to runs that start
# with the gaze averted.
COMPARED = {
    "rms_deg": ("gaze_error_rms_deg", "RMS gaze error [deg]", 2),
    "stable_contact_s": ("time_to_stable_contact_s", "time to stable contact where both reach it [s]", 3),
    "overshoot_deg": ("overshoot_deg", "overshoot where both reach the person [deg]", 2),
}
# Prefix of the differences in `summary.json`.
DIFFERENCES = "mpc_minus_lookahead_"
_RESAMPLES = 2000
_SEED = 20210603
# Tolerance of ties.
_TIE = 1e-9


def bootstrap_mean(values: Sequence[float | None], people: Sequence[str]) -> tuple[float, float, float]:
    """Mean over clips with its 95 % confidence interval from a cluster bootstrap over people.

    Clips of one person are correlated, so people are resampled; clips have equal weight.

    Args:
        values: One value per clip, shape (N,); None and NaN are ignored.
        people: Person in each clip, shape (N,).

    Returns:
        Mean, lower and upper end; NaN without values, ends NaN with fewer than two people.
    """
    each = np.asarray(values, dtype=np.float64)
    known = np.isfinite(each)
    if not known.any():
        return math.nan, math.nan, math.nan
    names, person_index = np.unique(np.asarray(people)[known], return_inverse=True)
    total, count = np.bincount(person_index, weights=each[known]), np.bincount(person_index)
    mean = float(total.sum() / count.sum())
    if len(names) == 1:
        return mean, math.nan, math.nan
    draws = np.random.default_rng(_SEED).integers(len(names), size=(_RESAMPLES, len(names)))
    means = total[draws].sum(axis=1) / count[draws].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return mean, float(low), float(high)


def add_gap_closed(rows: list[dict[str, Any]]) -> None:
    """Add ``gap_closed``: (reactive error - own error) / (reactive error - error with the true future).

    Args:
        rows: Runs, modified in place; None if the reactive run or the run with the true future is missing, or if the
            latter is not better.
    """

    def place(row: dict[str, Any]) -> tuple[Any, ...]:
        return row["source"], row["neck"], row["sensor"], row["seed"]

    perfect = {place(r): r.get("gaze_error_rms_deg") for r in rows if r["controller"] == TRUE_FUTURE}
    reactive = {(*place(r), r["predictor"]): r.get("gaze_error_rms_deg") for r in rows if r["controller"] == "reactive"}
    for row in rows:
        best = perfect.get(place(row))
        # The run with the true future has no predictor and is the reference of every predictor.
        worst = reactive.get((*place(row), row["predictor"]))
        own = row.get("gaze_error_rms_deg")
        if row["controller"] == TRUE_FUTURE and own is not None:
            row["gap_closed"] = 1.0
        elif best is None or worst is None or own is None or worst <= best:
            row["gap_closed"] = None
        else:
            row["gap_closed"] = (worst - own) / (worst - best)


def summarise(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means by sensor x group or kind x controller x predictor x neck.

    Args:
        rows: Runs with metrics (none left out or failed).

    Returns:
        One row per combination: labels, ``n_clips``, ``n_people``, the mean of each metric under its name and its
        interval under ``<name>_ci95``.
    """
    if not rows:
        return []
    figures = [name for name in (*METRICS, "gap_closed") if name in rows[0]]
    table = []
    for labels, chosen in _combinations(rows, ("controller", "predictor", "neck")):
        people = [str(r["subject"]) for r in chosen]
        entry = labels | {"n_clips": len({r["source"] for r in chosen}), "n_people": len(set(people))}
        for name in figures:
            entry |= with_interval(name, [r[name] for r in chosen], people)
        table.append(entry)
    return table


def _combinations(
    rows: Sequence[dict[str, Any]], names: Sequence[str]
) -> Iterator[tuple[dict[str, Any], list[dict[str, Any]]]]:
    """Labels and runs of each sensor, group or kind, and combination of the named columns."""
    for sensor, clips in [(s, clips) for s in sensors_of(rows) for clips in clips_of(rows)]:
        for values, found in grouped(rows, *names).items():
            if chosen := [r for r in found if r["sensor"] == sensor and clips.hold(r)]:
                yield {"sensor": sensor, **vars(clips), **dict(zip(names, values, strict=True))}, chosen


def with_interval(name: str, values: Sequence[float | None], people: Sequence[str]) -> dict[str, Any]:
    """Mean under a name, and its interval under ``<name>_ci95``, from `bootstrap_mean`; None for NaN."""
    mean, low, high = bootstrap_mean(values, people)
    ends = [low, high] if math.isfinite(low) else None
    return {name: mean if math.isfinite(mean) else None, f"{name}_ci95": ends}


def paired_differences(rows: Sequence[dict[str, Any]], figure: str, first: str, second: str) -> list[dict[str, Any]]:
    """Paired difference of two controllers on the same recording, sensor, predictor and neck.

    Args:
        rows: Runs with metrics.
        figure: Metric.
        first: Controller of the minuend.
        second: Controller of the subtrahend.

    Returns:
        One row per sensor, group or kind, predictor and neck: mean difference, interval, number of pairs, and numbers
        of negative and positive differences.
    """

    def same(row: dict[str, Any]) -> tuple[Any, ...]:
        return row["source"], row["neck"], row["sensor"], row["seed"], row["predictor"]

    others = {same(r): r for r in rows if r["controller"] == second}
    pairs = [(r, others[same(r)]) for r in rows if r["controller"] == first and same(r) in others]
    known = [a | {"difference": a[figure] - b[figure]} for a, b in pairs if None not in (a[figure], b[figure])]
    table = []
    for labels, chosen in _combinations(known, ("predictor", "neck")):
        values = [r["difference"] for r in chosen]
        found = with_interval("difference", values, [str(r["subject"]) for r in chosen])
        counts = {
            "n_clips": len(values),
            "n_less": sum(value < -_TIE for value in values),
            "n_more": sum(value > _TIE for value in values),
        }
        table.append(labels | {"difference": found["difference"], "ci95": found["difference_ci95"]} | counts)
    return table
