"""Figures of forecast errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.aggregate import groups_of
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
