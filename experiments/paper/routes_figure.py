"""Figure of the routes: every walk from above, a panel for each route group."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Rectangle, Wedge

from experiments.aggregate import GROUP_ORDER
from gazempc.recordings.recording import Recording
from gazempc.recordings.synthetic.room import PAPER_ROOM, ROUTE_LANDMARKS, Room, way
from gazempc.results.figures.style import COLOURS
from gazempc.types import FloatArray

_ROUTES = {"straight": "R12 straight", "turn": "R34 turn", "sharp": "R56 sharp"}
# Of the side to which people go or turn, robot's or their own; who does not turn has none.
_COLOURS = {"left": COLOURS[0], "right": COLOURS[1], "none": "0.35"}
_VIEW, _PARTITION, _WALL, _DESK = "#F3EBD3", "0.1", "0.55", "#C9B79C"
_DESK_M = 0.6
_TURN_STEP_S = 0.5
_STANDING_M = 0.1
_ARROW_M = 0.25


def draw_routes(recordings: Sequence[Recording], path: Path) -> None:
    """Draw all walks from above with the sensor's view; where all are synthetic, also the paper's room.

    In the room, walks are coloured by the side of the desk to which they go, else by the side to which people turn.

    Args:
        recordings: Walks in the base frame: synthetic ones as generated, others placed by
            `gazempc.recordings.placement.place`.
        path: PNG file to write.

    Raises:
        ValueError: There are no recordings.
    """
    if not recordings:
        raise ValueError("there are no recordings to draw")
    synthetic = all(recording.kind == "synthetic" for recording in recordings)
    groups = sorted({_group(recording) for recording in recordings}, key=lambda g: (g not in GROUP_ORDER, _order(g), g))
    plot = Figure(figsize=(4.3 * len(groups) + 0.4, 4.8), layout="constrained")
    axes = np.atleast_1d(plot.subplots(1, len(groups), sharex=True, sharey=True))
    shown = set()
    for ax, group in zip(axes, groups, strict=True):
        own = [recording for recording in recordings if _group(recording) == group]
        _draw_sensor(ax, PAPER_ROOM)
        if synthetic:
            _draw_room(ax, PAPER_ROOM)
        for recording in own:
            side = _target_side(recording) if synthetic else _turn_side(recording)
            shown.add(side)
            _draw_walk(ax, recording, _COLOURS[side])
            if synthetic:
                _draw_ways(ax, recording, _COLOURS[side])
        title = _ROUTES.get(group, group) if synthetic else group
        ax.set_title(f"{title} ({len(own)} walks)", fontsize="medium")
        ax.set_xlabel("to the robot's left, y (m)")
        ax.set_aspect("equal")
    axes[0].set_ylabel("ahead of the robot, x (m)")
    axes[0].xaxis.set_inverted(True)
    legend = _legend([side for side in _COLOURS if side in shown], PAPER_ROOM, synthetic)
    columns = len(legend) if len(groups) > 2 else 3
    plot.legend(handles=legend, loc="outside lower center", ncols=columns, frameon=False, fontsize="small")
    kinds = " and ".join(dict.fromkeys(recording.kind for recording in recordings))
    plot.suptitle(
        "Synthetic walks. Room, desks and camera after the paper's text; the room's layout is ours"
        if synthetic
        else f"Recorded walks ({kinds}) with the robot's sensor at the origin",
        fontsize="medium",
    )
    plot.savefig(path, dpi=150)


def _group(recording: Recording) -> str:
    return recording.labels.group or "no group"


def _order(group: str) -> int:
    return GROUP_ORDER.index(group) if group in GROUP_ORDER else len(GROUP_ORDER)


def _seen_path_m(recording: Recording) -> FloatArray:
    return recording.truth.head_position_m[recording.truth.valid, :2]


def _target_side(recording: Recording) -> str:
    return ROUTE_LANDMARKS[recording.name.split("_")[1]][1]


def _turn_side(recording: Recording) -> str:
    """Side to which a person turns from start to end, by the direction from each half second to the next."""
    if _group(recording) == "straight":
        return "none"
    seen, path_m = recording.times_s[recording.truth.valid], _seen_path_m(recording)
    grid_s = np.arange(seen[0], seen[-1], _TURN_STEP_S)
    steps_m = np.diff(np.column_stack([np.interp(grid_s, seen, path_m[:, axis]) for axis in range(2)]), axis=0)
    steps_m = steps_m[np.hypot(steps_m[:, 0], steps_m[:, 1]) > _STANDING_M]
    if len(steps_m) < 2:
        return "none"
    direction_rad = np.unwrap(np.arctan2(steps_m[:, 1], steps_m[:, 0]))
    return "left" if direction_rad[-1] > direction_rad[0] else "right"


def _legend(sides: Sequence[str], room: Room, synthetic: bool) -> list[Artist]:
    words = ("target on the robot's left", "target on its right") if synthetic else ("turns left", "turns right")
    labels = dict(zip(_COLOURS, (*words, "straight"), strict=True))
    nearest_m, farthest_m = room.sensor_range_m
    view = f"sensor's view, {nearest_m:g}-{farthest_m:g} m, {np.degrees(2 * room.sensor_half_angle_rad):.0f}°"
    handles: list[Artist] = [Line2D([], [], color=_COLOURS[side], label=labels[side]) for side in sides]
    handles += [
        Line2D([], [], color="0.35", marker="o", ms=4, ls="", label="start"),
        Line2D([], [], color="0.35", marker=">", ms=5, ls="", label="end"),
        Line2D([], [], color="k", marker="^", ls="", label="sensor"),
        Patch(color=_VIEW, label=view),
    ]
    if synthetic:
        handles += [
            Line2D([], [], color="0.35", lw=0.8, ls=":", label="way to and from desks"),
            Line2D([], [], color=_PARTITION, lw=3, label="partition"),
            Line2D([], [], color=_WALL, lw=2.5, label="wall"),
        ]
    return handles


def _draw_sensor(ax: Axes, room: Room) -> None:
    nearest_m, farthest_m = room.sensor_range_m
    half_deg = float(np.degrees(room.sensor_half_angle_rad))
    field = Wedge((0, 0), farthest_m, 90 - half_deg, 90 + half_deg, width=farthest_m - nearest_m, fc=_VIEW, ec="none")
    ax.add_patch(field).set_zorder(0)
    ax.plot(0, 0, "^", color="k", ms=8, zorder=6)


def _draw_room(ax: Axes, room: Room) -> None:
    """Draw walls, partitions and desks; the page's axes are y and x."""
    (x0, x1), (y0, y1) = room.x_m, room.y_m
    ax.add_patch(Rectangle((y0, x0), y1 - y0, x1 - x0, fill=False, ec=_WALL, lw=2.5, zorder=1))
    for partition in room.partitions:
        ends = np.array([partition.start_m, partition.end_m])
        ax.plot(ends[:, 1], ends[:, 0], color=_PARTITION, lw=3, solid_capstyle="butt", zorder=5)
    for landmark in room.landmarks:
        x, y = landmark.position_m
        corner = (y - _DESK_M / 2, x - _DESK_M / 2)
        ax.add_patch(Rectangle(corner, _DESK_M, _DESK_M, fc=_DESK, ec="0.3", lw=0.8, zorder=5))
        ax.text(y, x, landmark.name, ha="center", va="center", fontsize="xx-small", zorder=6)


def _draw_ways(ax: Axes, recording: Recording, colour: str) -> None:
    """Draw how a person may have come from one desk and gone on to the other."""
    path_m = _seen_path_m(recording)
    start, end = ROUTE_LANDMARKS[recording.name.split("_")[1]]
    for desk, (x, y) in ((start, path_m[0]), (end, path_m[-1])):
        found = way(desk, (float(x), float(y)))
        ax.plot(found[:, 1], found[:, 0], color=colour, lw=0.6, ls=":", alpha=0.5, zorder=2)


def _draw_walk(ax: Axes, recording: Recording, colour: str) -> None:
    """Draw a walk with a dot at its start and an arrowhead at its end."""
    path_m = recording.truth.head_position_m[:, :2]
    ax.plot(path_m[:, 1], path_m[:, 0], color=colour, lw=0.9, alpha=0.8, zorder=3)
    seen_m = _seen_path_m(recording)
    ax.plot(seen_m[0, 1], seen_m[0, 0], "o", color=colour, ms=3.5, mew=0, zorder=4)
    apart_m = np.hypot(*(seen_m - seen_m[-1]).T)
    before, last = seen_m[np.flatnonzero(apart_m >= min(_ARROW_M, apart_m.max()))[-1]], seen_m[-1]
    tail, tip = (float(before[1]), float(before[0])), (float(last[1]), float(last[0]))
    arrow = FancyArrowPatch(tail, tip, arrowstyle="-|>", mutation_scale=8, lw=0, fc=colour)
    ax.add_patch(arrow).set_zorder(4)
