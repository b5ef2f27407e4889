"""Figures of forecast errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.clips import groups_of
from gazempc.results.figures.style import COLOURS, readable

_STYLES = ("-", "--", ":", "-.")
_CUE_LABELS = {"none": "no orientation", "head": "head", "pelvis": "pelvis", "both": "head and pelvis"}
_NOMINAL = {0.68: "o", 0.95: "^"}


def draw(rows: Sequence[dict[str, Any]], about: str, path: Path) -> None:
    """Draw mean error against horizon, a panel for each group.

    Args:
        rows: As made by `experiments.forecast.summary.summarise`, of one sensor; the first of several cues is drawn.
        about: What data and sensor they are from.
        path: PNG file to write.
    """
    rows = [r for r in rows if r["cues"] == rows[0]["cues"] and r["kind"] == "all"]
    groups = groups_of(r for r in rows if r["group"] != "all")
    predictors = list(dict.fromkeys(r["predictor"] for r in rows))
    width_inches = 3.0 * len(groups) + 0.6
    with readable(width_inches):
        plot = Figure(figsize=(width_inches, 3.6), layout="constrained")
        axes = np.atleast_1d(plot.subplots(1, len(groups), sharey=True))
        for ax, group in zip(axes, groups, strict=True):
            for k, predictor in enumerate(predictors):
                own = [r for r in rows if (r["group"], r["predictor"]) == (group, predictor) and r["error_true_mm"]]
                own.sort(key=lambda r: r["horizon_s"])
                colour = COLOURS[k % len(COLOURS)]
                x, y = [r["horizon_s"] for r in own], [r["error_true_mm"] for r in own]
                label = predictor if group == groups[0] else None
                ax.plot(
                    x, y, marker="o", linestyle=_STYLES[k // len(COLOURS) % len(_STYLES)], color=colour, label=label
                )
                for r in own:
                    if interval := r["error_true_mm_ci95"]:
                        ax.plot([r["horizon_s"]] * 2, interval, color=colour, linewidth=1)
            n = max(r["n_clips"] for r in rows if r["group"] == group)
            ax.set_title(f"{group} ({n} clips)", fontsize="medium")
            ax.set_xlabel("horizon from capture (s)")
            # From the best to the last position is a factor of ten.
            ax.set_yscale("log")
            ax.grid(alpha=0.3, which="both")
        axes[0].set_ylabel("mean forecast error (mm), logarithmic")
        plot.legend(loc="outside upper center", ncols=min(len(predictors), 5), frameon=False, fontsize="small")
        plot.supxlabel(about, fontsize="small", color="0.4")
        plot.savefig(path, dpi=150)


def draw_cues(rows: Sequence[dict[str, Any]], about: str, path: Path, horizon_s: float) -> None:
    """Draw what the orientations of head and pelvis are worth: error with and without them, a panel for each group.

    Args:
        rows: As made by `experiments.forecast.summary.summarise`, of one sensor and more than one choice of cues.
            Predictors to which cues make no difference are left out.
        about: What data and sensor they are from.
        path: PNG file to write.
        horizon_s: Horizon to show.
    """
    rows = [r for r in rows if r["kind"] == "all" and r["horizon_s"] == horizon_s and r["error_true_mm"] is not None]
    groups = groups_of(r for r in rows if r["group"] != "all")
    predictors = [
        p
        for p in dict.fromkeys(r["predictor"] for r in rows)
        if len({round(r["error_true_mm"], 3) for r in rows if (r["predictor"], r["group"]) == (p, "all")}) > 1
    ]
    cues = [c for c in _CUE_LABELS if any(r["cues"] == c for r in rows)]
    with readable(10.0):
        plot = Figure(figsize=(10.0, 3.4), layout="constrained")
        axes = np.atleast_1d(plot.subplots(1, len(groups), sharey=True))
        width = 0.8 / len(cues)
        for ax, group in zip(axes, groups, strict=True):
            for k, cue in enumerate(cues):
                own = {r["predictor"]: r["error_true_mm"] for r in rows if (r["group"], r["cues"]) == (group, cue)}
                x = [i + (k - (len(cues) - 1) / 2) * width for i in range(len(predictors))]
                label = _CUE_LABELS[cue] if ax is axes[0] else None
                ax.bar(x, [own.get(p, math.nan) for p in predictors], width, color=COLOURS[k], label=label)
            ax.set_xticks(range(len(predictors)), predictors, rotation=30, ha="right", fontsize="small")
            ax.set_title(group, fontsize="medium")
            ax.grid(axis="y", alpha=0.3)
        axes[0].set_ylabel(f"mean error at {horizon_s:g} s (mm)")
        plot.legend(loc="outside upper center", ncols=len(cues), frameon=False, fontsize="small")
        plot.supxlabel(about, fontsize="small", color="0.4")
        plot.savefig(path, dpi=150)


def draw_coverage(rows: Sequence[dict[str, Any]], about: str, path: Path) -> None:
    """Draw stated against found: share of errors inside the ellipsoids that should hold 68 and 95 %.

    Args:
        rows: As made by `experiments.forecast.summary.summarise`, of one sensor; the first of several cues is drawn.
        about: What data and sensor they are from.
        path: PNG file to write.
    """
    rows = [r for r in rows if r["coverage_68"] is not None and (r["cues"], r["kind"]) == (rows[0]["cues"], "all")]
    if not rows:
        return
    groups = groups_of(r for r in rows if r["group"] != "all")
    predictors = list(dict.fromkeys(r["predictor"] for r in rows))
    horizons_s = sorted({r["horizon_s"] for r in rows})
    with readable(10.0):
        plot = Figure(figsize=(10.0, 3.8), layout="constrained")
        axes = np.atleast_1d(plot.subplots(1, len(groups), sharey=True))
        for ax, group in zip(axes, groups, strict=True):
            for nominal, marker in _NOMINAL.items():
                ax.axhline(nominal, color="0.6", linewidth=1, zorder=0)
                for k, horizon_s in enumerate(horizons_s):
                    own = {
                        r["predictor"]: r[f"coverage_{round(100 * nominal)}"]
                        for r in rows
                        if (r["group"], r["horizon_s"]) == (group, horizon_s)
                    }
                    x = [i + 0.2 * (k - (len(horizons_s) - 1) / 2) for i in range(len(predictors))]
                    label = f"{100 * nominal:.0f} %, {horizon_s:g} s" if ax is axes[0] else None
                    colour = COLOURS[k % len(COLOURS)]
                    ax.plot(
                        x, [own.get(p, math.nan) for p in predictors], marker, color=colour, markersize=5, label=label
                    )
            ax.set_xticks(range(len(predictors)), predictors, rotation=45, ha="right", fontsize="small")
            ax.set_title(group, fontsize="medium")
            ax.set_ylim(0, 1.03)
            ax.grid(axis="x", alpha=0.2)
        axes[0].set_ylabel("share of errors inside what\nshould hold 68 % and 95 %")
        plot.legend(loc="outside upper center", ncols=2 * len(horizons_s), frameon=False, fontsize="small")
        plot.supxlabel(about, fontsize="small", color="0.4")
        plot.savefig(path, dpi=150)
