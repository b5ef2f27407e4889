"""Pan and tilt over time: true and observed head, command and joint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gazempc.neck.kinematics import look_at, unwrap_pan
from gazempc.results.figures.known import draw_known, finish, shown_head
from gazempc.results.figures.style import DPI, Logs, shade_unscored, style
from gazempc.results.log import Log
from gazempc.types import FloatArray

_LIMIT_NEAR_DEG = 10.0
_OBSERVED: dict[str, Any] = {"color": "k", "ls": "", "marker": ".", "ms": 2.5, "mew": 0.0, "alpha": 0.6}


def angles(logs: Logs, path: Path) -> None:
    """Draw pan and tilt over time: true and observed head, command and joint, one column for each controller.

    The observed heads stand at their capture times. Nothing is drawn for the true head where nobody knows it.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    figure = Figure(figsize=(max(2.0 + 2.7 * len(logs), 6.4), 5.6), dpi=DPI, layout="constrained")
    axes = figure.subplots(2, len(logs), sharex=True, sharey="row", squeeze=False)
    limits_shown = False
    for column, (name, log) in zip(axes.T, logs.items(), strict=True):
        time_s = log.time_s - log.time_s[0]
        neck, look, head = log.neck, style(name), shown_head(log)
        targets, seen = _toward(log, head.log.head_true_base_m), _toward(log, log.head_observed_base_m)
        seen_s = log.capture_time_s - log.time_s[0]
        limits_deg = np.rad2deg([neck.position_min_rad, neck.position_max_rad])
        for axis, ax in enumerate(column):
            curves = np.rad2deg([targets[:, axis], log.command_position_rad[:, axis], log.joint_position_rad[:, axis]])
            shade_unscored(ax, float(time_s[-1]))
            ax.plot(seen_s, np.rad2deg(seen[:, axis]), **_OBSERVED)
            if head.known.any():
                draw_known(ax, time_s, curves[0], head, color="k", lw=2.6, alpha=0.35)
            ax.plot(time_s, curves[1], color=look.colour, lw=1.3, ls=(0, (4, 1.5)))
            ax.plot(time_s, curves[2], color=look.colour, lw=1.8)
            for limit in limits_deg[:, axis]:
                if np.nanmin(curves) - _LIMIT_NEAR_DEG <= limit <= np.nanmax(curves) + _LIMIT_NEAR_DEG:
                    ax.axhline(limit, color="k", lw=1.2, ls=":")
                    limits_shown = True
            ax.grid(color="0.9", lw=0.6)
        column[0].set_title(look.label)
        column[1].set_xlabel("time (s)")
    axes[0, 0].set(ylabel="pan, left + (deg)", xlim=(0.0, float(time_s[-1])))
    axes[1, 0].set_ylabel("tilt, up + (deg)")
    # The legend shows kinds of line in a neutral colour, because the colour says which controller it is.
    key = axes[0, 0]
    if any(shown_head(log).known.any() for log in logs.values()):
        key.plot([], [], color="k", lw=2.6, alpha=0.35, label=shown_head(next(iter(logs.values()))).label)
    key.plot([], [], **_OBSERVED, label="observed head")
    key.plot([], [], color="0.3", lw=1.3, ls=(0, (4, 1.5)), label="command sent")
    key.plot([], [], color="0.3", lw=1.8, label="joint")
    if limits_shown:
        key.plot([], [], color="k", lw=1.2, ls=":", label="joint limit")
    figure.legend(
        *key.get_legend_handles_labels(), loc="outside lower center", ncols=5 if len(logs) > 2 else 3, frameon=False
    )
    finish(figure, logs, path)


def _toward(log: Log, head_base_m: FloatArray) -> FloatArray:
    neck = log.neck
    return unwrap_pan(
        look_at(neck.geometry, head_base_m).angles_rad,
        float(log.joint_position_rad[0, 0]),
        float(neck.position_min_rad[0]),
        float(neck.position_max_rad[0]),
    )
