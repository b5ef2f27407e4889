"""Pan and tilt over time: true and observed head, command and joint; or directions of gaze, head and body."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gazempc.neck.kinematics import gaze_ray, look_at_rad, pan_tilt_rad, unwrap_pan
from gazempc.neck.spec import AXES
from gazempc.results.figures.known import draw_known, finish, parts, shown_head
from gazempc.results.figures.style import DPI, OBSERVED, Logs, note, readable, shade_unscored, styles
from gazempc.results.log import Log
from gazempc.types import FloatArray, IntArray

_LIMIT_NEAR_DEG = 10.0
_COMMAND: dict[str, Any] = {"lw": 1.3, "ls": (0, (4, 1.5))}
_ACTUAL: dict[str, Any] = {"lw": 1.8}
_HEAD: dict[str, Any] = {"color": "k", "lw": 2.6, "alpha": 0.35}
_LIMIT: dict[str, Any] = {"color": "k", "lw": 1.2, "ls": ":"}


def angles(logs: Logs, path: Path) -> None:
    """Draw pan and tilt over time: true and observed head, command and joint, one column for each controller.

    Observed heads are drawn at their capture times, the true head where it is known. For a neck with eyes or a body,
    the directions of gaze, head and body replace command and joint.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    width = max(2.0 + 2.7 * len(logs), 6.4)
    with readable(width):
        figure = Figure(figsize=(width, 6.0), dpi=DPI, layout="constrained")
        axes = figure.subplots(2, len(logs), sharex=True, sharey="row", squeeze=False)
        looks, drawn = styles(logs), dict[str, dict[str, Any]]()
        for column, (name, log) in zip(axes.T, logs.items(), strict=True):
            drawn |= _draw_column(column, log, looks[name].colour)
            column[0].set_title(looks[name].label.replace(" with ", "\nwith ") if len(logs) > 2 else looks[name].label)
            column[1].set_xlabel("time (s)")
        end_s = max(float(log.time_s[-1] - log.time_s[0]) for log in logs.values())
        axes[0, 0].set(ylabel="pan, left + (deg)", xlim=(0.0, end_s))
        axes[1, 0].set_ylabel("tilt, up + (deg)")
        # Legend of the line styles in use, in a neutral colour: colour denotes the controller.
        for label, look in drawn.items():
            axes[0, 0].plot([], [], **look, label=label)
        handles, columns = axes[0, 0].get_legend_handles_labels(), 5 if len(logs) > 2 else 3
        figure.legend(*handles, loc="outside lower center", ncols=columns, frameon=False)
        finish(figure, logs, path)


def _draw_column(column: Any, log: Log, colour: str) -> dict[str, dict[str, Any]]:
    """Draw one run.

    Args:
        column: Axes for pan and for tilt.
        log: The run.
        colour: Colour of its controller.

    Returns:
        The drawn curves: name -> look, for the legend.
    """
    time_s, seen_s = log.time_s - log.time_s[0], log.capture_time_s - log.time_s[0]
    head, neck = shown_head(log), log.neck
    ticks = np.arange(log.time_s.size)
    targets = _toward(log, head.log.head_true_base_m, ticks)
    seen_at = np.clip(np.searchsorted(log.time_s, log.capture_time_s), 0, ticks[-1])
    seen = _toward(log, log.head_observed_base_m, seen_at)
    limits_deg = np.rad2deg([neck.position_min_rad, neck.position_max_rad])
    drawn: dict[str, dict[str, Any]] = {}
    for axis, ax in enumerate(column):
        shade_unscored(ax, float(time_s[-1]))
        if seen.size:
            ax.plot(seen_s, np.rad2deg(seen[:, axis]), **OBSERVED)
            drawn["observed head"] = OBSERVED
        if head.known.any():
            draw_known(ax, time_s, np.rad2deg(targets[:, axis]), head, **_HEAD)
            drawn[head.label] = _HEAD
        curves = {"command sent": (log.command_position_rad, _COMMAND), "joint": (log.joint_position_rad, _ACTUAL)}
        if neck.joints > len(AXES):
            curves = _of_gaze(log)
        for label, (values_rad, look) in curves.items():
            if not np.isfinite(values_rad[:, axis]).any():
                continue
            ax.plot(time_s, np.rad2deg(values_rad[:, axis]), color=colour, **look)
            drawn[label] = {"color": "0.3", **look}
        if not np.isfinite(log.joint_position_rad).any():
            note(ax, "the joints were not read")
        if neck.joints == len(AXES):
            shown = np.concatenate([np.asarray(line.get_ydata(), dtype=np.float64) for line in ax.lines])
            low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
            for limit in limits_deg[:, axis]:
                if low - _LIMIT_NEAR_DEG <= limit <= high + _LIMIT_NEAR_DEG:
                    ax.axhline(limit, **_LIMIT)
                    drawn["joint limit"] = _LIMIT
        ax.grid(color="0.9", lw=0.6)
    return drawn


def _of_gaze(log: Log) -> dict[str, tuple[FloatArray, dict[str, Any]]]:
    """Directions of gaze, head and body: name -> angles, shape (M, 2), radians, and look."""
    _, gaze = gaze_ray(log.neck.geometry, log.joint_position_rad)
    curves: dict[str, tuple[FloatArray, dict[str, Any]]] = {}
    for part in parts(log):
        angles_rad = _continuous(log, pan_tilt_rad(part.direction))
        if part.level:
            angles_rad[:, 1] = np.nan
        curves[part.label] = angles_rad, {"lw": 1.3, "ls": part.line}
    return curves | {"gaze": (_continuous(log, pan_tilt_rad(gaze)), _ACTUAL)}


def _toward(log: Log, head_base_m: FloatArray, ticks: IntArray) -> FloatArray:
    """Pan and tilt towards heads, shape (K, 2), radians: joint angles, or for a redundant neck the gaze direction."""
    if log.neck.joints == len(AXES):
        return _continuous(log, look_at_rad(log.neck.geometry, head_base_m))
    joints_rad = np.where(np.isfinite(log.joint_position_rad), log.joint_position_rad, log.command_position_rad)
    eye_m, _ = gaze_ray(log.neck.geometry, joints_rad[ticks])
    return _continuous(log, pan_tilt_rad(head_base_m - eye_m))


def _continuous(log: Log, angles_rad: FloatArray) -> FloatArray:
    known = np.isfinite(angles_rad).all(axis=1)
    start_rad = log.command_position_rad[0, 0]
    low_rad, high_rad = float(log.neck.position_min_rad[0]), float(log.neck.position_max_rad[0])
    smooth = angles_rad.copy()
    if known.any():
        smooth[known] = unwrap_pan(angles_rad[known], float(start_rad), low_rad, high_rad)
    return smooth
