"""Figure of forecast errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.aggregate import groups_of

# Okabe and Ito's colours, which colour-blind people can tell apart.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_STYLES = ("-", "--", ":", "-.")
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
            colour = _COLOURS[k % len(_COLOURS)]
            x, y = [r["horizon_s"] for r in own], [r["error_true_mm"] for r in own]
            label = line[0] + _CUES[line[1]] if group == groups[0] else None
            ax.plot(x, y, marker="o", linestyle=_STYLES[k // len(_COLOURS) % len(_STYLES)], color=colour, label=label)
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
