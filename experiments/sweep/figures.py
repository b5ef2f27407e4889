"""Figures of a sweep: response curves and Pareto fronts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.aggregate import GROUP_ORDER, bootstrap_mean
from experiments.engine.job import Row
from experiments.sweep.names import with_unit
from experiments.sweep.plan import SweepPlan
from experiments.sweep.spec import METRICS, Objective, direction_of
from experiments.sweep.tables import pareto_front
from gazempc.results.figures.style import COLOURS, readable, series_look, styles
from gazempc.results.run_summary import LABELS as CONTROLLER_LABELS

_DPI = 150
# What makes a gaze: two lines that differ in one of these and not in their controller have one colour.
_OF_A_GAZE = ("case", "controller", "predictor", "neck")


def draw_all(plan: SweepPlan, rows: Sequence[Row], table: Sequence[Row], out: Path) -> list[Path]:
    """Draw the figures that the sweep file asks for.

    Args:
        plan: The sweep.
        rows: All runs.
        table: Means, as made by `experiments.sweep.tables.point_table`.
        out: Folder to write PNG files to.

    Returns:
        The files.
    """
    done = [row for row in rows if not row["failed"] and not row["left_out"]]
    overall = [row for row in table if row["group"] == "all"]
    drawn: dict[str, Figure] = {}
    for x, metric, by in plan.spec.figures.response:
        drawn[f"response_{_file(x)}_{metric}"] = _response(done, x, metric, by)
    for x, y, by in plan.spec.figures.pareto:
        drawn[f"pareto_{x}_{y}"] = _pareto(overall, x, y, by)
    for name, figure in drawn.items():
        figure.supxlabel(recorded_or_synthetic(plan), fontsize="small", color="0.4")
        figure.savefig(out / f"{name}.png", dpi=_DPI)
    return [out / f"{name}.png" for name in drawn]


def recorded_or_synthetic(plan: SweepPlan) -> str:
    """Say how many of a sweep's recordings are synthetic.

    Args:
        plan: The sweep.

    Returns:
        Such as ``12 synthetic walks``.
    """
    synthetic = sum(walk.is_synthetic for walk in plan.walks)
    parts = [(synthetic, "synthetic"), (len(plan.walks) - synthetic, "recorded")]
    return ", ".join(f"{n} {kind} walk{'s' if n > 1 else ''}" for n, kind in parts if n)


def _response(rows: Sequence[Row], x: str, metric: str, by: str) -> Figure:
    with readable(7.0):
        figure = Figure(figsize=(7.0, 4.2), layout="constrained")
        ax = figure.subplots()
        ticks = distinct(rows, x)
        numeric = is_numeric(ticks)
        # Cases are different questions: a line never averages over them.
        cases = distinct(rows, "case")
        of_case = {c: [r for r in rows if r["case"] == c and r[x] is not None] for c in cases}
        series = [(c, b) for c in cases for b in distinct(of_case[c], by)]
        for i, (case, one) in enumerate(series):
            label = said(one) if by == "case" or len(cases) == 1 else f"{said(case)}, {said(one)}"
            at, means, low, high = [], [], [], []
            for place, tick in enumerate(ticks):
                chosen = [r for r in rows if (r["case"], r[by], r[x]) == (case, one, tick) and r[metric] is not None]
                if not chosen:
                    continue
                mean, lower, upper = bootstrap_mean([r[metric] for r in chosen], [str(r["subject"]) for r in chosen])
                # Categories stand side by side, so that their intervals do not hide one another.
                at.append(tick if numeric else place + 0.12 * (i - (len(series) - 1) / 2))
                means.append(mean)
                low.append(lower)
                high.append(upper)
            colour, look = colour_of(rows, by, one, i, case), series_look(i)
            if numeric:
                ax.plot(at, means, ls=look.line, marker=look.marker, color=colour, markersize=4, label=label)
                ax.fill_between(at, low, high, color=colour, alpha=0.2, linewidth=0)
                # Intervals of one colour are told apart by their edges.
                ax.plot(at, np.column_stack([low, high]), ls=look.line, color=colour, linewidth=0.7)
            else:
                ends = np.maximum(np.nan_to_num([np.subtract(means, low), np.subtract(high, means)]), 0.0)
                ax.errorbar(at, means, ends, fmt=look.marker, color=colour, capsize=3, label=label)
        if not numeric:
            ax.set_xticks(range(len(ticks)), [said(tick) for tick in ticks])
        ax.set(xlabel=with_unit(x), ylabel=with_unit(metric))
        ax.grid(alpha=0.3)
        ax.legend(framealpha=0.85, edgecolor="none", fontsize="small", title=with_unit(by))
        ax.set_title("means over clips, 95 % intervals over people", fontsize="medium")
        return figure


def _pareto(table: Sequence[Row], x: str, y: str, by: str) -> Figure:
    with readable(7.0):
        figure = Figure(figsize=(7.0, 4.8), layout="constrained")
        ax = figure.subplots()
        objectives = [Objective(metric=metric, direction=direction_of(metric)) for metric in (x, y)]
        for i, one in enumerate(distinct(table, by)):
            chosen = [r for r in table if r[by] == one and r[x] is not None and r[y] is not None]
            front = pareto_front(chosen, objectives)
            colour, look = colour_of(table, by, one, i), series_look(i)
            point: dict[str, Any] = {"marker": look.marker, "color": colour, "markersize": 5}
            ax.plot([r[x] for r in chosen], [r[y] for r in chosen], ls="", alpha=0.35, **point)
            ax.plot([r[x] for r in front], [r[y] for r in front], ls=look.line, label=said(one), **point)
        ax.set(xlabel=with_unit(x), ylabel=with_unit(y))
        ax.grid(alpha=0.3)
        ax.legend(framealpha=0.85, edgecolor="none", fontsize="small", title=f"{with_unit(by)}; lines: Pareto fronts")
        ax.set_title("means over clips", fontsize="medium")
        return figure


def distinct(rows: Sequence[Row], name: str) -> list[Any]:
    """Values of a column, each once: groups in reading order, numbers by size; None is none."""
    found = [value for value in dict.fromkeys(row[name] for row in rows) if value is not None]
    if name == "group":
        return [group for group in (*GROUP_ORDER, "all") if group in found]
    return sorted(found) if is_numeric(found) else found


def is_numeric(values: Sequence[Any]) -> bool:
    """Whether there are values, and all are numbers."""
    return bool(values) and all(isinstance(value, (int, float)) for value in values)


def colour_of(rows: Sequence[Row], by: str, one: Any, index: int, case: str | None = None) -> str:
    """Colour of a line: that of its gaze, unless other things are compared than gazes; then one of its own.

    Args:
        rows: What is drawn.
        by: What tells the lines apart.
        one: Its value for this line.
        index: Number of the line.
        case: The line's case; None where it is of all.
    """
    every = dict.fromkeys(row["controller"] for row in rows)
    own = {row["controller"] for row in rows if row[by] == one and (case is None or row["case"] == case)}
    if len(own) == 1 and (len(every) > 1 or by in _OF_A_GAZE):
        return styles(every)[next(iter(own))].colour
    return COLOURS[index % len(COLOURS)]


def said(value: Any) -> str:
    """A value for people."""
    return CONTROLLER_LABELS.get(value, f"{value:g}" if isinstance(value, float) else str(value))


def _file(name: str) -> str:
    return name.replace(".", "-") if name not in METRICS else name
