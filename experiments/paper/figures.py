"""Figures of the validation: errors by group, the filter's time constant against w, other yaws to turn by."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.paper.published import PUBLISHED
from gazempc.results.figures.style import COLOURS, readable

_BASELINE, _PROPOSED = COLOURS[0], COLOURS[1]


def _caption(summary: Mapping[str, Any]) -> str:
    groups = summary["groups"]
    people = max(g["n_people"] for g in groups)
    return f"{', '.join(summary['kinds'])}: {sum(g['n_videos'] for g in groups)} videos, up to {people} people a group"


def draw_bars(summary: Mapping[str, Any], path: Path) -> None:
    """Draw the mean error by group and method: published, with the validation's filter (two w), and with a slow one.

    Args:
        summary: As saved in `summary.json`.
        path: PNG file to write.
    """
    groups = [g["group"] for g in summary["groups"]]
    published = [
        {"group": p.group, "baseline_mm": p.baseline_mm, "proposed_mm": p.proposed_mm}
        for p in PUBLISHED
        if p.group in groups
    ]
    nearest = next(n for n in summary["nearest"] if n["against"] == "true")
    fixed = summary["published_weights"][0]
    quick = f"filter of {summary['settings']['filter_time_s']:.2g} s, own positions"
    panels: list[tuple[str, list[dict[str, Any]]]] = [
        ("published", published),
        (f"{quick},\nw tuned (mean {summary['w_mean']:.2f})", summary["groups"]),
        (f"{quick},\nw = {fixed['weight']:g}", fixed["groups"]),
        (
            f"filter of {nearest['filter_time_s']:.2g} s, true positions,\nw tuned (mean {nearest['w_mean']:.2f})",
            nearest["groups"],
        ),
    ]
    with readable(12.0):
        plot = Figure(figsize=(12.0, 3.9), layout="constrained")
        axes = plot.subplots(1, len(panels), sharey=True)
        for ax, (title, rows) in zip(axes, panels, strict=True):
            _bars(ax, rows)
            ax.set_title(title, fontsize="medium")
        axes[0].set_ylabel("mean error 0.5 s ahead (mm)")
        handles, labels = axes[0].get_legend_handles_labels()
        plot.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False)
        plot.supxlabel(f"{_caption(summary)}; bars with 95 % intervals over people", fontsize="small", color="0.4")
        plot.savefig(path, dpi=150)


def _bars(ax: Axes, rows: list[dict[str, Any]]) -> None:
    for k, (name, label, colour) in enumerate(
        (("baseline_mm", "baseline (Kalman)", _BASELINE), ("proposed_mm", "proposed (head pose)", _PROPOSED))
    ):
        x = np.arange(len(rows)) + 0.4 * (k - 0.5)
        heights = [r[name] for r in rows]
        ax.bar(x, heights, width=0.38, color=colour, label=label)
        for at, row in zip(x, rows, strict=True):
            top = row[name]
            if interval := row.get(f"{name}_ci95"):
                ax.plot([at, at], interval, color="black", linewidth=1)
                top = max(top, interval[1])
            ax.annotate(f"{row[name]:.0f}", (at, top), (0, 2), textcoords="offset points", ha="center", fontsize=8)
    ax.set_xticks(range(len(rows)), [r["group"] for r in rows])
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(axis="y", alpha=0.3)
