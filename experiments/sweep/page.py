"""The report of a sweep."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from experiments.engine.job import Row
from experiments.pages import failures, left_out, survived
from experiments.plots import Plot
from experiments.sweep.figures import distinct, point_name, recorded_or_synthetic, value_text
from experiments.sweep.names import with_unit
from experiments.sweep.plan import SweepPlan
from experiments.sweep.tables import means_table
from gazempc.results.page.content import Page, Unusual


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
        summary: What is in `summary.json`.
        rows: All runs.
        table: Means, as made by `experiments.sweep.tables.point_table`.
        plots: Its plots.
        pictures: The plots that were drawn, by their files.
        command: The command that repeats it.

    Returns:
        The report.
    """
    people = len({walk.subject for walk in plan.walks})
    overall = [row for row in table if row["group"] == "all"]
    return Page(
        title=f"Sweep {plan.spec.name}",
        question=" ".join(plan.spec.question.split())
        or f"What comes of changing {' and '.join(map(with_unit, plan.spec.varied()))}?",
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
        charts=tuple(plot.chart() for plot in plots if not plot.ticks),
        pictures={path: f"{plot.y_label} over {plot.x_label}" for path, plot in pictures.items()},
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
            yield f"{most} {with_unit(objective.metric)}: {best[objective.metric]:.4g}, of {point_name(plan, best)}."


def _unusual(summary: Row) -> Iterator[Unusual]:
    if violations := summary["limit_violations"]:
        yield Unusual(f"{violations} violations of a neck's limits")
    yield from failures(summary["failed"])
    yield from survived(summary["faults"])
    yield from left_out(summary["left_out"])
