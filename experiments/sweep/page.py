"""The report of a sweep."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.engine.job import Row
from experiments.pages import failures, left_out, survived
from experiments.sweep.figures import colour_of, distinct, is_numeric, recorded_or_synthetic, said
from experiments.sweep.names import with_unit
from experiments.sweep.plan import SweepPlan
from experiments.sweep.spec import Objective, direction_of
from experiments.sweep.tables import means_table, pareto_front
from gazempc.results.page.content import Chart, Curve, Page, Unusual


def sweep_page(
    plan: SweepPlan, summary: Row, rows: Sequence[Row], table: Sequence[Row], pictures: Iterable[Path], command: str
) -> Page:
    """The report of a sweep.

    Args:
        plan: The sweep.
        summary: What is in `summary.json`.
        rows: All runs.
        table: Means, as made by `experiments.sweep.tables.point_table`.
        pictures: Figures.
        command: What repeats it.

    Returns:
        The report.
    """
    people = len({walk.subject for walk in plan.walks})
    overall = [row for row in table if row["group"] == "all"]
    done = [row for row in rows if not row["failed"] and not row["left_out"]]
    return Page(
        title=f"Sweep {plan.spec.name}",
        question=" ".join(plan.spec.question.split())
        or f"What comes of changing {' and '.join(map(with_unit, plan.spec.varied()))}?",
        answer=tuple(_answers(plan, overall)),
        setup={
            "recordings": f"{recorded_or_synthetic(plan)} of {people} {'people' if people > 1 else 'person'}",
            "varied": "; ".join(
                f"{with_unit(name)}: {', '.join(map(said, distinct(rows, name)))}" for name in plan.spec.varied()
            ),
            "fixed": ", ".join(f"{with_unit(name)} {value}" for name, value in plan.spec.base.items()) or "defaults",
            "runs": str(summary["n_runs"]),
            "seed": str(summary["seed"]),
        },
        tables=(means_table(plan, table, "Means over clips"),),
        charts=(*_responses(plan, done), *_fronts(plan, overall)),
        pictures={path: path.stem.replace("_", " ") for path in pictures},
        unusual=tuple(_unusual(summary)),
        command=command,
        settings=summary["spec"],
    )


def _answers(plan: SweepPlan, overall: Sequence[Row]) -> Iterator[str]:
    for objective in plan.spec.objectives:
        known = [row for row in overall if row[objective.metric] is not None]
        if known:
            best = (max if objective.direction == "maximize" else min)(known, key=lambda row: row[objective.metric])
            most = "Highest" if objective.direction == "maximize" else "Lowest"
            yield f"{most} {with_unit(objective.metric)}: {best[objective.metric]:.4g}, of {_point(plan, best)}."


def _responses(plan: SweepPlan, done: Sequence[Row]) -> Iterator[Chart]:
    for x, metric, by in plan.spec.figures.response:
        if not is_numeric(distinct(done, x)):
            continue
        curves = []
        # Cases are different questions: a line never averages over them.
        series = dict.fromkeys((row["case"], row[by]) for row in done if row[x] is not None)
        for i, (case, one) in enumerate(series):
            of_line = [r for r in done if (r["case"], r[by]) == (case, one) and r[metric] is not None]
            at = distinct(of_line, x)
            means = [np.mean([row[metric] for row in of_line if row[x] == tick]) for tick in at]
            name = said(one) if by == "case" or len({case for case, _ in series}) == 1 else f"{case}, {said(one)}"
            colour = colour_of(done, by, one, i, case)
            curves.append(Curve(name, colour, np.array(at, float), np.array(means, float)))
        yield Chart(f"{with_unit(metric)} over {with_unit(x)}", with_unit(x), with_unit(metric), tuple(curves))


def _fronts(plan: SweepPlan, overall: Sequence[Row]) -> Iterator[Chart]:
    asked = list(plan.spec.figures.pareto)
    if not asked and len(plan.spec.objectives) > 1:
        first, second = (objective.metric for objective in plan.spec.objectives[:2])
        asked = [(second, first, "case")]
    for x, y, by in asked:
        objectives = [Objective(metric=metric, direction=direction_of(metric)) for metric in (x, y)]
        curves = []
        for i, one in enumerate(distinct(overall, by)):
            front = pareto_front((row for row in overall if row[by] == one), objectives)
            xs, ys = (np.array([row[metric] for row in front], float) for metric in (x, y))
            names = tuple(_point(plan, row) for row in front)
            curves.append(Curve(said(one), colour_of(overall, by, one, i), xs, ys, names))
        title = f"{with_unit(y)} against {with_unit(x)}: points that no other beats"
        yield Chart(title, with_unit(x), with_unit(y), tuple(curves))


def _point(plan: SweepPlan, row: Row) -> str:
    varied: dict[str, Any] = {name: row[name] for name in plan.spec.varied() if row[name] is not None}
    case = "" if row["case"] == plan.spec.name else f"{row['case']}: "
    return case + ", ".join(f"{with_unit(name)} {said(value)}" for name, value in varied.items())


def _unusual(summary: Row) -> Iterator[Unusual]:
    if violations := summary["limit_violations"]:
        yield Unusual(f"{violations} violations of a neck's limits")
    yield from failures(summary["failed"])
    yield from survived(summary["faults"])
    yield from left_out(summary["left_out"])
