"""Figures of the validation: mean errors by group, and the routes of the synthetic walks from above."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Rectangle, Wedge

from experiments.aggregate import GROUP_ORDER
from experiments.paper.published import PUBLISHED
from gazempc.recordings.recording import Recording
from gazempc.recordings.synthetic.room import PAPER_ROOM, ROUTE_LANDMARKS, Room, way
from gazempc.results.figures.style import COLOURS, readable
from gazempc.types import FloatArray

_ROUTES = {"straight": "R12 straight", "turn": "R34 turn", "sharp": "R56 sharp"}
# Of the side of the desk to which people go.
_COLOURS = {"left": COLOURS[0], "right": COLOURS[1]}
_VIEW, _PARTITION, _WALL, _DESK = "#F3EBD3", "0.1", "0.55", "#C9B79C"
_DESK_M = 0.6
_ARROW_M = 0.25


def draw_routes(walks: Sequence[Recording], path: Path) -> None:
    """Draw synthetic walks from above in the paper's room, coloured by the side of the desk to which they go.

    Args:
        walks: Synthetic walks in the base frame.
        path: PNG file to write.
    """
    groups = [group for group in GROUP_ORDER if any(walk.labels.group == group for walk in walks)]
    plot = Figure(figsize=(4.3 * len(groups) + 0.4, 4.8), layout="constrained")
    axes = np.atleast_1d(plot.subplots(1, len(groups), sharex=True, sharey=True))
    for ax, group in zip(axes, groups, strict=True):
        own = [walk for walk in walks if walk.labels.group == group]
        _draw_room(ax, PAPER_ROOM)
        for walk in own:
            desks = ROUTE_LANDMARKS[walk.name.split("_")[1]]
            _draw_walk(ax, walk.truth.head_position_m[:, :2], desks, _COLOURS[desks[1]])
        ax.set_title(f"{_ROUTES[group]} ({len(own)} walks)", fontsize="medium")
        ax.set_xlabel("to the robot's left, y (m)")
        ax.set_aspect("equal")
    axes[0].set_ylabel("ahead of the robot, x (m)")
    axes[0].xaxis.set_inverted(True)
    nearest_m, farthest_m = PAPER_ROOM.sensor_range_m
    angle_deg = np.degrees(2 * PAPER_ROOM.sensor_half_angle_rad)
    handles = [
        Line2D([], [], color=_COLOURS["left"], label="target on the robot's left"),
        Line2D([], [], color=_COLOURS["right"], label="target on its right"),
        Line2D([], [], color="0.35", marker="o", ms=4, ls="", label="start"),
        Line2D([], [], color="0.35", marker=">", ms=5, ls="", label="end"),
        Line2D([], [], color="k", marker="^", ls="", label="sensor"),
        Patch(color=_VIEW, label=f"sensor's view, {nearest_m:g}-{farthest_m:g} m, {angle_deg:.0f}°"),
        Line2D([], [], color="0.35", lw=0.8, ls=":", label="way to and from desks"),
        Line2D([], [], color=_PARTITION, lw=3, label="partition"),
        Line2D([], [], color=_WALL, lw=2.5, label="wall"),
    ]
    columns = len(handles) if len(groups) > 2 else 3
    plot.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize="small")
    title = "Synthetic walks. Room, desks and camera after the paper's text; the room's layout is ours"
    plot.suptitle(title, fontsize="medium")
    plot.savefig(path, dpi=150)


def _draw_room(ax: Axes, room: Room) -> None:
    """Draw the sensor, walls, partitions and desks; the page's axes are y and x."""
    nearest_m, farthest_m = room.sensor_range_m
    half_deg = float(np.degrees(room.sensor_half_angle_rad))
    field = Wedge((0, 0), farthest_m, 90 - half_deg, 90 + half_deg, width=farthest_m - nearest_m, fc=_VIEW, ec="none")
    ax.add_patch(field).set_zorder(0)
    ax.plot(0, 0, "^", color="k", ms=8, zorder=6)
    (x0, x1), (y0, y1) = room.x_m, room.y_m
    ax.add_patch(Rectangle((y0, x0), y1 - y0, x1 - x0, fill=False, ec=_WALL, lw=2.5, zorder=1))
    for partition in room.partitions:
        ends = np.array(partition)
        ax.plot(ends[:, 1], ends[:, 0], color=_PARTITION, lw=3, solid_capstyle="butt", zorder=5)
    for landmark in room.landmarks:
        x, y = landmark.position_m
        corner = (y - _DESK_M / 2, x - _DESK_M / 2)
        ax.add_patch(Rectangle(corner, _DESK_M, _DESK_M, fc=_DESK, ec="0.3", lw=0.8, zorder=5))
        ax.text(y, x, landmark.name, ha="center", va="center", fontsize="xx-small", zorder=6)


def _draw_walk(ax: Axes, path_m: FloatArray, desks: tuple[str, str], colour: str) -> None:
    """Draw a walk, a dot at its start, an arrowhead at its end, and the likely ways from one desk and to the other."""
    for desk, (x, y) in zip(desks, path_m[[0, -1]].tolist(), strict=True):
        found = way(desk, (x, y))
        ax.plot(found[:, 1], found[:, 0], color=colour, lw=0.6, ls=":", alpha=0.5, zorder=2)
    ax.plot(path_m[:, 1], path_m[:, 0], color=colour, lw=0.9, alpha=0.8, zorder=3)
    ax.plot(path_m[0, 1], path_m[0, 0], "o", color=colour, ms=3.5, mew=0, zorder=4)
    apart_m = np.hypot(*(path_m - path_m[-1]).T)
    tail, tip = path_m[[np.flatnonzero(apart_m >= min(_ARROW_M, apart_m.max()))[-1], -1], ::-1].tolist()
    arrow = FancyArrowPatch(tail, tip, arrowstyle="-|>", mutation_scale=8, lw=0, fc=colour)
    ax.add_patch(arrow).set_zorder(4)


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
