"""Tables of a sweep: one row a run, means for each point, and the points that no other beats."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from experiments.aggregate import bootstrap_mean, groups_of
from experiments.engine.job import Row
from experiments.sweep.names import with_unit
from experiments.sweep.plan import Point, SweepPlan, Walk
from experiments.sweep.spec import METRICS, Case, Objective
from gazempc.results.page.content import PageTable


def run_row(plan: SweepPlan, case: Case, index: int, point: Point, walk: Walk, result: Row) -> Row:
    """One row of `results.csv`.

    Args:
        plan: The sweep.
        case: The case, complete.
        index: Number of the point in its case.
        point: What varies.
        walk: The recording.
        result: What came of the run.

    Returns:
        Labels, the value of everything that varies in any case (None where the case says nothing of it), all metrics,
        and ``faults`` if exceptions were survived.
    """
    values = {**case.base, **point}
    return {
        "case": case.name,
        "point": index,
        "recording": walk.name,
        "subject": walk.subject,
        "group": walk.group,
        "controller": values["controller"],
        **{name: values.get(name) for name in plan.spec.varied()},
        **{name: result[name] for name in ("controller_name", "predictor_name") if name in result},
        "left_out": result.get("left_out"),
        "failed": result.get("failed"),
        "simulated_s": result.get("simulated_s"),
        **{name: result.get(name) for name in METRICS},
        **({"faults": result["faults"]} if "faults" in result else {}),
    }


def point_table(plan: SweepPlan, rows: Sequence[Row]) -> list[Row]:
    """Means over clips for each point and group, with intervals over people.

    Args:
        plan: The sweep.
        rows: All runs.

    Returns:
        One row a point and group (``all`` too): labels, ``n_clips``, ``n_people``, and each tabulated metric with
        ``<metric>_low`` and ``<metric>_high``; None where there is nothing to say.
    """
    done = [row for row in rows if not row["failed"] and not row["left_out"]]
    by_point: dict[tuple[str, int], list[Row]] = {}
    for row in done:
        by_point.setdefault((row["case"], row["point"]), []).append(row)
    table = []
    for of_point in by_point.values():
        for group in groups_of(of_point):
            chosen = [row for row in of_point if group in {"all", row["group"]}]
            people = [str(row["subject"]) for row in chosen]
            first = chosen[0]
            entry: Row = {name: first[name] for name in ("case", "point", "controller", *plan.spec.varied())}
            entry |= {"group": group, "n_clips": len(chosen), "n_people": len(set(people))}
            for metric in tabulated(plan):
                mean_low_high = bootstrap_mean([_number(row[metric]) for row in chosen], people)
                for name, value in zip((metric, f"{metric}_low", f"{metric}_high"), mean_low_high, strict=True):
                    entry[name] = value if math.isfinite(value) else None
            table.append(entry)
    return table


def tabulated(plan: SweepPlan) -> tuple[str, ...]:
    """Metrics of the table: those that were asked for, and those that objectives and figures need."""
    spec = plan.spec
    drawn = [metric for _, metric, _ in spec.figures.response]
    drawn += [metric for x, y, _ in spec.figures.pareto for metric in (x, y)]
    return tuple(dict.fromkeys([*spec.metrics, *(o.metric for o in spec.objectives), *drawn]))


def pareto_front(rows: Iterable[Row], objectives: Sequence[Objective]) -> list[Row]:
    """Rows that no other row beats: none is as good in every objective and better in one.

    Args:
        rows: Means.
        objectives: What is better.

    Returns:
        The front, by rising value of the first objective; rows without a value of an objective are not on it.
    """
    known = [row for row in rows if all(row[o.metric] is not None for o in objectives)]
    if not known:
        return []
    sign = np.array([1.0 if o.direction == "minimize" else -1.0 for o in objectives])
    costs = sign * np.array([[row[o.metric] for o in objectives] for row in known])
    beaten = [bool(np.any(np.all(costs <= cost, axis=1) & np.any(costs < cost, axis=1))) for cost in costs]
    front = [row for row, lost in zip(known, beaten, strict=True) if not lost]
    return sorted(front, key=lambda row: row[objectives[0].metric])


def objective_means(rows: Sequence[Row], objectives: Sequence[Objective]) -> list[float] | None:
    """Means of the objectives over the clips of one point.

    Args:
        rows: Its runs.
        objectives: Which metrics.

    Returns:
        The means; None if a run failed or a mean is not known.
    """
    used = [row for row in rows if not row["left_out"]]
    values = np.array([[_number(row[o.metric]) for o in objectives] for row in used])
    if not used or any(row["failed"] for row in used) or not np.isfinite(values).all():
        return None
    return [float(value) for value in values.mean(axis=0)]


def means_table(plan: SweepPlan, table: Sequence[Row], title: str) -> PageTable:
    """The means over all groups."""
    metrics = [metric for metric in tabulated(plan) if metric in plan.spec.metrics]
    columns = list(dict.fromkeys(["case", "controller", *plan.spec.varied(), "n_clips", *metrics]))
    rows = tuple(tuple(_cell(row[c]) for c in columns) for row in table if row["group"] == "all")
    shown = {"n_clips": "clips"}
    return PageTable(title, tuple(shown.get(column, with_unit(column)) for column in columns), rows)


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)
