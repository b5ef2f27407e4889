"""Figures of forecast errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.aggregate import groups_of

# Okabe and Ito's colours, which colour-blind people can tell apart.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_STYLES = ("-", "--", ":", "-.")
_CUE_LABELS = {"none": "no orientation", "head": "head", "pelvis": "pelvis", "both": "head and pelvis"}
_NOMINAL = (0.68, 0.90, 0.95)
_CUES = {"both": "", "head": ", head only", "pelvis": ", pelvis only", "none": ", no orientation"}


def draw(rows: Sequence[dict[str, Any]], kinds: str, path: Path) -> None:
    """Draw mean error against horizon, a panel for each group.

    Args:
        rows: As made by `experiments.forecast.summarise`.
        kinds: What kinds of recordings they are from.
        path: PNG file to write.
    """
    groups = groups_of(r for r in rows if r["group"] != "all")
    lines = list(dict.fromkeys((r["predictor"], r["cues"]) for r in rows))
    plot = Figure(figsize=(3.0 * len(groups) + 0.6, 3.6), layout="constrained")
    axes = np.atleast_1d(plot.subplots(1, len(groups), sharey=True))
    for ax, group in zip(axes, groups, strict=True):
        for k, line in enumerate(lines):
            own = [r for r in rows if (r["group"], r["predictor"], r["cues"]) == (group, *line) and r["error_true_mm"]]
            own.sort(key=lambda r: r["horizon_s"])
            colour = COLOURS[k % len(COLOURS)]
            x, y = [r["horizon_s"] for r in own], [r["error_true_mm"] for r in own]
            label = line[0] + _CUES[line[1]] if group == groups[0] else None
            ax.plot(x, y, marker="o", linestyle=_STYLES[k // len(COLOURS) % len(_STYLES)], color=colour, label=label)
            for r in own:
                if interval := r["error_true_mm_ci95"]:
                    ax.plot([r["horizon_s"]] * 2, interval, color=colour, linewidth=1)
        n = max(r["n_clips"] for r in rows if r["group"] == group)
        ax.set_title(f"{group} ({n} clips)", fontsize="medium")
        ax.set_xlabel("horizon from capture (s)")
        ax.set_ylim(bottom=0)
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("mean forecast error (mm)")
    plot.legend(loc="outside upper center", ncols=min(len(lines), 4), frameon=False, fontsize="small")
    plot.supxlabel(kinds, fontsize="x-small", color="0.4")
    plot.savefig(path, dpi=150)


def draw_cues(rows: Sequence[dict[str, Any]], kinds: str, path: Path, horizon_s: float) -> None:
    """Draw what the orientations of head and pelvis are worth: error without them against error with them.

    Args:
        rows: As made by `experiments.forecast.summarise`, for more than one choice of cues.
        kinds: What kinds of recordings they are from.
        path: PNG file to write.
        horizon_s: Horizon to show.
    """
    groups = groups_of(rows)
    predictors = list(dict.fromkeys(r["predictor"] for r in rows))
    cues = [c for c in _CUE_LABELS if any(r["cues"] == c for r in rows)]
    plot = Figure(figsize=(1.2 * len(predictors) * len(groups) / 2 + 2.0, 3.4), layout="constrained")
    axes = np.atleast_1d(plot.subplots(1, len(groups), sharey=True))
    width = 0.8 / len(cues)
    for ax, group in zip(axes, groups, strict=True):
        for k, cue in enumerate(cues):
            own = {
                r["predictor"]: r["error_true_mm"]
                for r in rows
                if (r["group"], r["cues"], r["horizon_s"]) == (group, cue, horizon_s) and r["error_true_mm"]
            }
            x = [predictors.index(p) + (k - (len(cues) - 1) / 2) * width for p in own]
            ax.bar(x, list(own.values()), width, color=COLOURS[k], label=_CUE_LABELS[cue] if ax is axes[0] else None)
        ax.set_xticks(range(len(predictors)), predictors, rotation=30, ha="right", fontsize="small")
        ax.set_title(group, fontsize="medium")
        ax.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel(f"mean error at {horizon_s:g} s (mm)")
    plot.legend(loc="outside upper center", ncols=len(cues), frameon=False, fontsize="small")
    plot.supxlabel(kinds, fontsize="x-small", color="0.4")
    plot.savefig(path, dpi=150)


def draw_coverage(rows: Sequence[dict[str, Any]], kinds: str, path: Path) -> None:
    """Draw stated against found: share of errors inside the ellipsoids that should hold 68, 90 and 95 %.

    Args:
        rows: As made by `experiments.forecast.summarise`; of several cues the first ones are drawn.
        kinds: What kinds of recordings they are from.
        path: PNG file to write.
    """
    rows = [r for r in rows if r["coverage_68"] is not None]
    first = next((r["cues"] for r in rows), None)
    rows = [r for r in rows if r["cues"] == first]
    if not rows:
        return
    groups = groups_of(rows)
    predictors = list(dict.fromkeys(r["predictor"] for r in rows))
    plot = Figure(figsize=(2.6 * len(groups) + 0.6, 3.4), layout="constrained")
    axes = np.atleast_1d(plot.subplots(1, len(groups), sharey=True))
    for ax, group in zip(axes, groups, strict=True):
        for nominal in _NOMINAL:
            ax.axhline(nominal, color="0.8", linewidth=1, zorder=0)
        for k, predictor in enumerate(predictors):
            own = sorted(
                (r for r in rows if (r["group"], r["predictor"]) == (group, predictor)), key=lambda r: r["horizon_s"]
            )
            for nominal, marker in zip(_NOMINAL, ("v", "s", "^"), strict=True):
                ax.plot(
                    [r["horizon_s"] for r in own],
                    [r[f"coverage_{round(100 * nominal)}"] for r in own],
                    marker=marker,
                    linestyle=_STYLES[k // len(COLOURS) % len(_STYLES)],
                    color=COLOURS[k % len(COLOURS)],
                    label=predictor if group == groups[0] and nominal == _NOMINAL[0] else None,
                )
        ax.set_title(group, fontsize="medium")
        ax.set_xlabel("horizon from capture (s)")
        ax.set_ylim(0, 1.02)
    axes[0].set_ylabel("share of errors inside the\nstated 68, 90, 95 % ellipsoids")
    plot.legend(loc="outside upper center", ncols=min(len(predictors), 4), frameon=False, fontsize="small")
    plot.supxlabel(kinds, fontsize="x-small", color="0.4")
    plot.savefig(path, dpi=150)
