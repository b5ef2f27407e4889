"""Plots of a sweep: response curves and Pareto fronts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from experiments.aggregate import GROUP_ORDER, bootstrap_mean
from experiments.engine.job import Row
from experiments.plots import Line, Plot
from experiments.sweep.names import with_unit
from experiments.sweep.plan import SweepPlan
from experiments.sweep.spec import METRICS, Objective, direction_of
from experiments.sweep.tables import pareto_front
from gazempc.results.figures.style import COLOURS, styles
from gazempc.results.run_summary import LABELS as CONTROLLER_LABELS

# What makes a gaze: two lines that differ in one of these and not in their controller have one colour.
_OF_A_GAZE = ("case", "controller", "predictor", "neck")


def plots_of(plan: SweepPlan, rows: Sequence[Row], table: Sequence[Row]) -> Iterator[tuple[str, Plot]]:
    """The figures of a sweep file; without a front there, that of the first two objectives.

    Args:
        plan: The sweep.
        rows: All runs.
        table: Means, as made by `experiments.sweep.tables.point_table`.

    Yields:
        Name of the file without its ending, empty for the report alone; and the plot.
    """
    done = [row for row in rows if not row["failed"] and not row["left_out"]]
    overall = [row for row in table if row["group"] == "all"]
    for x, metric, by in plan.spec.figures.response:
        name = x if x in METRICS else x.replace(".", "-")
        yield f"response_{name}_{metric}", _response(done, x, metric, by)
    for x, y, by in plan.spec.figures.pareto:
        yield f"pareto_{x}_{y}", _pareto(plan, overall, x, y, by)
    if not plan.spec.figures.pareto and len(plan.spec.objectives) > 1:
        y, x = (objective.metric for objective in plan.spec.objectives[:2])
        yield "", _pareto(plan, overall, x, y, "case")


def recorded_or_synthetic(plan: SweepPlan) -> str:
    """Numbers of synthetic and of recorded walks, such as ``12 synthetic walks``."""
    synthetic = sum(walk.is_synthetic for walk in plan.walks)
    parts = [(synthetic, "synthetic"), (len(plan.walks) - synthetic, "recorded")]
    return ", ".join(f"{n} {kind} walk{'s' if n > 1 else ''}" for n, kind in parts if n)


def _response(rows: Sequence[Row], x: str, metric: str, by: str) -> Plot:
    ticks = distinct(rows, x)
    numeric = all(isinstance(tick, (int, float)) for tick in ticks)
    # Cases are different questions: a line never averages over them.
    series = dict.fromkeys((row["case"], row[by]) for row in rows if row[x] is not None)
    lines = []
    for i, (case, one) in enumerate(series):
        own = [r for r in rows if (r["case"], r[by]) == (case, one) and r[metric] is not None]
        at = distinct(own, x)
        chosen = [[r for r in own if r[x] == tick] for tick in at]
        means = [bootstrap_mean([r[metric] for r in part], [str(r["subject"]) for r in part]) for part in chosen]
        mean, low, high = np.reshape(means, (-1, 3)).T
        label = (
            value_text(one) if by == "case" or len({case for case, _ in series}) == 1 else f"{case}, {value_text(one)}"
        )
        places = np.array(at if numeric else [ticks.index(tick) for tick in at], dtype=np.float64)
        lines.append(Line(label, _colour(rows, by, one, i, case), places, mean, np.stack([low, high], axis=1)))
    title = f"{with_unit(metric)} over {with_unit(x)}"
    names = () if numeric else tuple(map(value_text, ticks))
    return Plot(title, with_unit(x), with_unit(metric), tuple(lines), with_unit(by), names)


def _pareto(plan: SweepPlan, table: Sequence[Row], x: str, y: str, by: str) -> Plot:
    objectives = [Objective(metric=metric, direction=direction_of(metric)) for metric in (x, y)]
    lines = []
    for i, one in enumerate(distinct(table, by)):
        chosen = [row for row in table if row[by] == one and row[x] is not None and row[y] is not None]
        front = pareto_front(chosen, objectives)
        points, every = (np.array([(r[x], r[y]) for r in part], float).reshape(-1, 2) for part in (front, chosen))
        names = tuple(point_name(plan, row) for row in front)
        lines.append(
            Line(value_text(one), _colour(table, by, one, i), points[:, 0], points[:, 1], names=names, beside=every)
        )
    title = f"{with_unit(y)} against {with_unit(x)}: Pareto fronts"
    return Plot(title, with_unit(x), with_unit(y), tuple(lines), with_unit(by))


def point_name(plan: SweepPlan, row: Row) -> str:
    """The settings of a point that vary."""
    varied = (f"{with_unit(name)} {value_text(row[name])}" for name in plan.spec.varied() if row[name] is not None)
    return ("" if row["case"] == plan.spec.name else f"{row['case']}: ") + ", ".join(varied)


def distinct(rows: Sequence[Row], name: str) -> list[Any]:
    """Values of a column, each once and without None: groups in reading order, numbers by size."""
    found = [value for value in dict.fromkeys(row[name] for row in rows) if value is not None]
    if name == "group":
        return [group for group in (*GROUP_ORDER, "all") if group in found]
    return sorted(found) if all(isinstance(value, (int, float)) for value in found) else found


def _colour(rows: Sequence[Row], by: str, one: Any, index: int, case: str | None = None) -> str:
    """Colour of a gaze where gazes are compared, else one by the number of the line."""
    every = dict.fromkeys(row["controller"] for row in rows)
    own = {row["controller"] for row in rows if row[by] == one and (case is None or row["case"] == case)}
    if len(own) == 1 and (len(every) > 1 or by in _OF_A_GAZE):
        return styles(every)[next(iter(own))].colour
    return COLOURS[index % len(COLOURS)]


def value_text(value: Any) -> str:
    """A value as text."""
    return CONTROLLER_LABELS.get(value, f"{value:g}" if isinstance(value, float) else str(value))
