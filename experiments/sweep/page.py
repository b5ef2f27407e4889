"""Tables, plots and report of a sweep: one row per run, means for each point, Pareto front, and response curves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.aggregate import GROUP_ORDER, METRICS, bootstrap_mean, grouped, groups_of
from experiments.engine.job import Row
from experiments.pages import unusual
from experiments.plots import Line, Plot
from experiments.sweep.names import with_unit
from experiments.sweep.plan import Point, SweepPlan, Walk
from experiments.sweep.spec import Case, Objective, direction_of
from gazempc.results.figures.style import COLOURS, styles
from gazempc.results.page.content import Page, PageTable
from gazempc.results.run_summary import LABELS as CONTROLLER_LABELS


def run_row(plan: SweepPlan, case: Case, index: int, point: Point, walk: Walk, result: Row) -> Row:
    """One row of `results.csv`.

    Args:
        plan: The sweep.
        case: The case, complete.
        index: Index of the point in its case.
        point: Values of the varied settings.
        walk: The recording.
        result: Result of the run.

    Returns:
        Labels, the value of each setting that varies in any case (None if the case does not set it), all metrics, and
        ``faults`` after caught exceptions.
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
        **{name: result[name] for name in ("controller_name", "predictor_name", "faults") if name in result},
        "left_out": result.get("left_out"),
        "failed": result.get("failed"),
        "simulated_s": result.get("simulated_s"),
        **{name: result.get(name) for name in METRICS},
    }


def point_table(plan: SweepPlan, rows: Sequence[Row]) -> list[Row]:
    """Means over clips for each point and group, with intervals over people.

    Args:
        plan: The sweep.
        rows: All runs.

    Returns:
        One row per point and group (including ``all``): labels, ``n_clips``, ``n_people``, and each tabulated metric
        with ``<metric>_low`` and ``<metric>_high``; None if undefined.
    """
    done = [row for row in rows if not row["failed"] and not row["left_out"]]
    table = []
    for of_point in grouped(done, "case", "point").values():
        for group in groups_of(of_point):
            chosen = [row for row in of_point if group in {"all", row["group"]}]
            people = [str(row["subject"]) for row in chosen]
            first = chosen[0]
            entry: Row = {name: first[name] for name in ("case", "point", "controller", *plan.spec.varied())}
            entry |= {"group": group, "n_clips": len(chosen), "n_people": len(set(people))}
            for metric in tabulated(plan):
                mean_low_high = bootstrap_mean([row[metric] for row in chosen], people)
                for name, value in zip((metric, f"{metric}_low", f"{metric}_high"), mean_low_high, strict=True):
                    entry[name] = value if math.isfinite(value) else None
            table.append(entry)
    return table


def tabulated(plan: SweepPlan) -> tuple[str, ...]:
    """Metrics of the table: the requested ones, and the objectives' and figures'."""
    spec = plan.spec
    drawn = [metric for _, metric, _ in spec.figures.response]
    drawn += [metric for x, y, _ in spec.figures.pareto for metric in (x, y)]
    return tuple(dict.fromkeys([*spec.metrics, *(o.metric for o in spec.objectives), *drawn]))


def pareto_front(rows: Iterable[Row], objectives: Sequence[Objective]) -> list[Row]:
    """Pareto front: rows that no other row dominates.

    Args:
        rows: Means.
        objectives: Metrics with their directions.

    Returns:
        The front in ascending order of the first objective, without rows that lack an objective.
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
        objectives: The metrics.

    Returns:
        The means; None if a run failed or a mean is undefined.
    """
    used = [row for row in rows if not row["left_out"]]
    values = np.array([[row[o.metric] for o in objectives] for row in used], dtype=np.float64)
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


# Columns that identify a gaze; lines of the same controller have the same colour.
_OF_A_GAZE = ("case", "controller", "predictor", "neck")


def plots_of(plan: SweepPlan, rows: Sequence[Row], table: Sequence[Row]) -> Iterator[tuple[str, Plot]]:
    """Figures of a sweep file; by default the Pareto front of the first two objectives is added.

    Args:
        plan: The sweep.
        rows: All runs.
        table: Result of `point_table`.

    Yields:
        File name without extension, empty for the report alone; and the plot.
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
    # One line per case: cases are not averaged.
    series = grouped((row for row in rows if row[x] is not None), "case", by)
    lines = []
    for i, ((case, one), every) in enumerate(series.items()):
        own = [r for r in every if r[metric] is not None]
        at = distinct(own, x)
        chosen = [[r for r in own if r[x] == tick] for tick in at]
        means = [bootstrap_mean([r[metric] for r in part], [str(r["subject"]) for r in part]) for part in chosen]
        mean, low, high = np.reshape(means, (-1, 3)).T
        label = (
            value_text(one) if by == "case" or len({case for case, _ in series}) == 1 else f"{case}, {value_text(one)}"
        )
        places = np.array(at if numeric else [ticks.index(tick) for tick in at], dtype=np.float64)
        lines.append(Line(label, _colour(rows, by, one, i, case), places, mean, ends=np.stack([low, high], axis=1)))
    title = f"{with_unit(metric)} over {with_unit(x)}"
    names = () if numeric else tuple(map(value_text, ticks))
    return Plot(title, with_unit(x), with_unit(metric), tuple(lines), legend=with_unit(by), ticks=names)


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
    return Plot(title, with_unit(x), with_unit(y), tuple(lines), legend=with_unit(by))


def point_name(plan: SweepPlan, row: Row) -> str:
    """Varied settings of a point, as text."""
    varied = (f"{with_unit(name)} {value_text(row[name])}" for name in plan.spec.varied() if row[name] is not None)
    return ("" if row["case"] == plan.spec.name else f"{row['case']}: ") + ", ".join(varied)


def distinct(rows: Sequence[Row], name: str) -> list[Any]:
    """Distinct values of a column except None: groups in the order of tables, numbers sorted."""
    found = [value for value in dict.fromkeys(row[name] for row in rows) if value is not None]
    if name == "group":
        return [group for group in (*GROUP_ORDER, "all") if group in found]
    return sorted(found) if all(isinstance(value, (int, float)) for value in found) else found


def _colour(rows: Sequence[Row], by: str, one: Any, index: int, case: str | None = None) -> str:
    """Colour of a gaze in comparisons of gazes, else by the index of the line."""
    every = dict.fromkeys(row["controller"] for row in rows)
    own = {row["controller"] for row in rows if row[by] == one and (case is None or row["case"] == case)}
    if len(own) == 1 and (len(every) > 1 or by in _OF_A_GAZE):
        return styles(every)[next(iter(own))].colour
    return COLOURS[index % len(COLOURS)]


def value_text(value: Any) -> str:
    """A value as text."""
    return CONTROLLER_LABELS.get(value, f"{value:g}" if isinstance(value, float) else str(value))


def sweep_page(
    plan: SweepPlan,
    summary: Row,
    rows: Sequence[Row],
    table: Sequence[Row],
    plots: Sequence[Plot],
    pictures: Mapping[Path, Plot],
    command: str,
) -> Page:
    """The report of a sweep.

    Args:
        plan: The sweep.
        summary: Content of `summary.json`.
        rows: All runs.
        table: Result of `point_table`.
        plots: The plots.
        pictures: PNG files of the plots.
        command: Command line that reproduces it.

    Returns:
        The report.
    """
    people = len({walk.subject for walk in plan.walks})
    overall = [row for row in table if row["group"] == "all"]
    return Page(
        title=f"Sweep {plan.spec.name}",
        question=" ".join(plan.spec.question.split())
        or f"What is the effect of {' and '.join(map(with_unit, plan.spec.varied()))}?",
        answer=tuple(_answers(plan, overall)),
        setup={
            "recordings": f"{recorded_or_synthetic(plan)} of {people} {'people' if people > 1 else 'person'}",
            "varied": "; ".join(
                f"{with_unit(name)}: {', '.join(map(value_text, distinct(rows, name)))}" for name in plan.spec.varied()
            ),
            "fixed": ", ".join(f"{with_unit(name)} {value}" for name, value in plan.spec.base.items()) or "defaults",
            "runs": str(summary["n_runs"]),
            "seed": str(summary["seed"]),
        },
        tables=(means_table(plan, table, "Means over clips"),),
        charts=tuple(plot for plot in plots if not plot.ticks),
        pictures={path: f"{plot.y_label} over {plot.x_label}" for path, plot in pictures.items()},
        unusual=tuple(unusual(summary, summary["limit_violations"])),
        command=command,
        settings=summary["spec"],
    )


def _answers(plan: SweepPlan, overall: Sequence[Row]) -> Iterator[str]:
    for objective in plan.spec.objectives:
        known = [row for row in overall if row[objective.metric] is not None]
        if known:
            best = (max if objective.direction == "maximize" else min)(known, key=lambda row: row[objective.metric])
            most = "Highest" if objective.direction == "maximize" else "Lowest"
            yield f"{most} {with_unit(objective.metric)}: {best[objective.metric]:.4g}, of {point_name(plan, best)}."
