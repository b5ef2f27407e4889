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
_RULE_LABELS = {
    "paper": "waist\n(paper)",
    "offset removed": "waist,\nmean removed",
    "travel direction": "travel\ndirection",
    "both": "travel,\nmean removed",
    "waist itself": "control: waist\nagainst travel",
}
_RULE_MARKERS = {"R12": "o", "R34": "s", "R56": "^"}


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


def draw_filters(summary: Mapping[str, Any], path: Path) -> None:
    """Draw the filter's time constant against the baseline's error, and against what w changes.

    Args:
        summary: As saved in `summary.json`.
        path: PNG file to write.
    """
    horizon_s = min(r["horizon_s"] for r in summary["filters"])
    rows = [r for r in summary["filters"] if r["horizon_s"] == horizon_s]
    groups = list(dict.fromkeys(r["group"] for r in rows))
    published = {p.group: p for p in PUBLISHED}
    width_inches = 3.3 * len(groups) + 0.8
    with readable(width_inches):
        plot = Figure(figsize=(width_inches, 7.0), layout="constrained")
        axes = plot.subplots(2, len(groups), squeeze=False)
        mesh = None
        for k, group in enumerate(groups):
            ax = axes[0, k]
            for against, style in (("filtered", "-"), ("true", "--")):
                own = [r for r in rows if (r["group"], r["against"]) == (group, against)]
                times_s = [r["filter_time_s"] for r in own]
                ax.plot(times_s, [r["baseline_mm"] for r in own], style, marker="o", color=_BASELINE, markersize=3)
                ax.plot(
                    times_s, [r["error_at_weight_mm"] for r in own], style, marker="s", color=_PROPOSED, markersize=3
                )
            ax.axhline(published[group].baseline_mm, color=_BASELINE, linewidth=1, linestyle=":")
            ax.axhline(published[group].proposed_mm, color=_PROPOSED, linewidth=1, linestyle=":")
            ax.set(xscale="log", ylim=(0, 700), title=group)
            ax.grid(alpha=0.3)
            ax = axes[1, k]
            own = [r for r in rows if (r["group"], r["against"]) == (group, "filtered")]
            change = np.array([[100.0 * (e / r["baseline_mm"] - 1.0) for e in r["error_mm"]] for r in own])
            mesh = ax.pcolormesh(
                summary["weights_swept"],
                [r["filter_time_s"] for r in own],
                change,
                cmap="RdBu_r",
                vmin=-30,
                vmax=30,
                shading="nearest",
            )
            ax.plot([r["weight"] for r in own], [r["filter_time_s"] for r in own], "k.-", linewidth=0.8)
            ax.set(yscale="log", xlabel="w", xlim=(0, 1))
            axes[0, k].set_xlabel("filter's time constant (s)")
        axes[0, 0].set_ylabel("mean error 0.5 s ahead (mm)")
        axes[1, 0].set_ylabel("filter's time constant (s)")
        if mesh is not None:
            plot.colorbar(mesh, ax=axes[1, -1], label="change by the rule (%), own positions", extend="both")
        for label, colour, style in (
            ("baseline", _BASELINE, "-"),
            ("proposed, best w", _PROPOSED, "-"),
            ("against the filter's own positions", "0.3", "-"),
            ("against the true positions", "0.3", "--"),
            ("published", "0.3", ":"),
            ("best w of all groups", "black", ".-"),
        ):
            axes[0, 0].plot([], [], style, color=colour, label=label)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        plot.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False, fontsize="small")
        plot.supxlabel(_caption(summary), fontsize="small", color="0.4")
        plot.savefig(path, dpi=150)


def draw_rules(summary: Mapping[str, Any], path: Path) -> None:
    """Draw what other yaws to turn by change, and what the head's offset costs on straight routes.

    Args:
        summary: As saved in `summary.json`.
        path: PNG file to write.
    """
    time_s = summary["settings"]["filter_time_s"]
    rows = [r for r in summary["rules"] if r["filter_time_s"] == time_s and r["group"] in _RULE_MARKERS]
    groups = list(dict.fromkeys(r["group"] for r in rows))
    rules = list(dict.fromkeys(r["rule"] for r in rows))
    with readable(11.0):
        plot = Figure(figsize=(11.0, 4.0), layout="constrained")
        left, right = plot.subplots(1, 2, width_ratios=[1.9, 1.0])
        for k, group in enumerate(groups):
            for i, rule in enumerate(rules):
                row = next(r for r in rows if (r["group"], r["rule"]) == (group, rule))
                x = i + 0.2 * (k - 0.5 * (len(groups) - 1))
                label = group if i == 0 else None
                left.plot(x, row["difference_mm"], _RULE_MARKERS[group], color=COLOURS[k], label=label)
                if interval := row["difference_ci95_mm"]:
                    left.plot([x, x], interval, color=COLOURS[k], linewidth=1)
        left.axhline(0, color="0.3", linewidth=0.8)
        left.set_xticks(range(len(rules)), [_RULE_LABELS[r] for r in rules])
        left.set_ylabel("proposed minus baseline (mm)")
        left.set_title(f"the head's yaw against ...; filter of {time_s:.2g} s", fontsize="medium")
        left.legend(frameon=False)
        yaw = summary["yaw"]
        right.plot(yaw["mean_yaw_deg"], yaw["cost_mm"], "o", color=COLOURS[0])
        right.axhline(0, color="0.3", linewidth=0.8)
        right.set(xlabel="mean yaw of head against waist (deg)", ylabel="proposed minus baseline (mm)")
        right.set_title(f"straight routes, w = {yaw['weight']:g}, a point a person", fontsize="medium")
        for ax in (left, right):
            ax.grid(alpha=0.3)
            ax.spines[["top", "right"]].set_visible(False)
        plot.supxlabel(
            f"{_caption(summary)}; below 0 the rule helps; lines: 95 % intervals over people",
            fontsize="small",
            color="0.4",
        )
        plot.savefig(path, dpi=150)
