"""The walk from above, with gaze rays at some instants."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from gazempc.neck.kinematics import gaze_ray
from gazempc.results.figures.known import Part, draw_known, parts, shown_head
from gazempc.results.figures.people import person_colour, turns
from gazempc.results.figures.style import OBSERVED, Logs, note, styles
from gazempc.results.log import Log
from gazempc.results.metrics import SCORED_FROM_S
from gazempc.types import FloatArray

_RAYS_AT_MOST = 5
# Length of the lines of head and body as a share of the distance to the person: longer ones would cross the gaze.
_PART_REACH = 0.45
# Labels need about this share of the drawing in the overview.
_LABEL_GAP = 0.1
# Band of the attended person, below the path.
_BAND: dict[str, Any] = {"lw": 8.0, "solid_capstyle": "round", "zorder": 2}


def draw_birds_eye(ax: Axes, logs: Logs) -> tuple[Part, ...]:
    """Draw the walk from above, the robot, and each controller's gaze rays at some instants.

    A gaze ray has the length of the distance from eye to head; a dotted line joins its end to the head at that time.
    The robot looks up the page and its left is on the left. For a neck with eyes or a body, shorter lines show the
    directions of head and body.

    Args:
        ax: Axes to draw on.
        logs: The runs.

    Returns:
        Parts drawn beside the gaze, such as the robot's head.
    """
    heads = {name: shown_head(log) for name, log in logs.items()}
    shown = next(iter(heads.values()))
    time_s, head = shown.log.time_s - shown.log.time_s[0], shown.log.head_true_base_m
    end_s = float(time_s[-1])
    ax.set_aspect("equal", adjustable="datalim")
    observed = next(iter(logs.values())).head_observed_base_m
    if len(observed) and not shown.known.any():
        ax.plot(observed[:, 1], observed[:, 0], **OBSERVED, zorder=3)
    path_m = _draw_attended(ax, shown.log)
    if shown.known.any():
        draw_known(ax, path_m[:, 1], path_m[:, 0], shown, color="0.25", lw=1.5, zorder=4)
    if not np.isfinite(head).any():
        note(ax, "no person was seen")
        _finish_plan(ax)
        return ()
    marks_s = np.arange(0.0, end_s + 1e-6)
    at = np.searchsorted(time_s, marks_s - 1e-6)
    # Rings, as the end of an accurate gaze ray covers a dot at the head.
    ax.plot(head[at, 1], head[at, 0], "o", mfc="w", mec="0.25", mew=1.5, ms=11, ls="", zorder=5)

    rays_s = marks_s[marks_s >= SCORED_FROM_S] if end_s >= SCORED_FROM_S else np.array([end_s])
    chosen = np.linspace(0, len(rays_s) - 1, min(len(rays_s), _RAYS_AT_MOST)).round().astype(int)
    looks, beside, gazes = styles(logs), dict[str, Part](), False
    for name, each in heads.items():
        look, log = looks[name], each.log
        tick = np.searchsorted(log.time_s, log.time_s[0] + rays_s[chosen] - 1e-6)
        eye, direction = gaze_ray(log.neck.geometry, log.joint_position_rad[tick])
        reach = np.linalg.norm(log.head_true_base_m[tick] - eye, axis=1, keepdims=True)
        tip = eye + reach * direction
        if not np.isfinite(tip).any():
            continue
        gazes = True
        ax.plot([eye[:, 1], tip[:, 1]], [eye[:, 0], tip[:, 0]], color=look.colour, lw=0.5 * look.width)
        for part in parts(log):
            end = eye + _PART_REACH * reach * part.direction[tick]
            ax.plot([eye[:, 1], end[:, 1]], [eye[:, 0], end[:, 0]], color=look.colour, lw=1.3, ls=part.line)
            beside[part.label] = part
        missed = np.stack([tip, log.head_true_base_m[tick]])
        ax.plot(missed[..., 1], missed[..., 0], color=look.colour, lw=1.0, ls=":")
        ax.plot(tip[:, 1], tip[:, 0], "D", color=look.colour, ms=5.5, mec="w", mew=0.5, zorder=6)

    if not gazes:
        note(ax, "no gaze: the joints were not read", 0.95)
    _label_times(ax, head, at, marks_s)
    _finish_plan(ax)
    return tuple(beside.values())


def _draw_attended(ax: Axes, log: Log) -> FloatArray:
    """Draw a band along each person's path while attended.

    Returns:
        The head with a gap at each change of the attended person, shape (M, 3), metres.
    """
    head = log.head_true_base_m.copy()
    if not log.attended_time_s.size:
        return head
    for turn in turns(log):
        span = np.searchsorted(log.time_s - log.time_s[0], [turn.from_s - 1e-6, turn.to_s - 1e-6])
        mine = head[slice(*span)]
        if turn.number and np.isfinite(mine).any():
            ax.plot(mine[:, 1], mine[:, 0], color=person_colour(turn.number), **_BAND)
        head[span[0]] = np.nan
    return head


def _finish_plan(ax: Axes) -> None:
    """Draw the robot; leave room for labels; name the axes."""
    ax.add_patch(FancyArrowPatch((0, 0), (0, 0.55), arrowstyle="-|>", mutation_scale=16, lw=2.5, fc="k", zorder=7))
    ax.plot(0, 0, "o", color="k", ms=11, zorder=7)
    ax.annotate("robot", (0, 0), (12, -3), textcoords="offset points", va="center")
    # Room for labels beside the path. Not by margins, which equal aspect may remove.
    low, high = np.array(ax.dataLim.min), np.array(ax.dataLim.max)
    pad = _LABEL_GAP * float(np.max(high - low))
    ax.update_datalim([low - pad, high + pad])
    ax.margins(0.0)
    ax.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    ax.yaxis.set_major_locator(MaxNLocator(8, integer=True))
    ax.xaxis.set_inverted(True)
    ax.set(xlabel="to the robot's left, y (m)", ylabel="ahead of the robot, x (m)")
    ax.grid(color="0.9", lw=0.6)
    ax.set_axisbelow(True)


def _label_times(ax: Axes, head: FloatArray, at: NDArray[np.intp], marks_s: FloatArray) -> None:
    """Label start, end and the seconds that fit, beside the path on the side away from the robot.

    Args:
        ax: Axes to draw on.
        head: True head, shape (M, 3), metres.
        at: Ticks of the marks, shape (K,).
        marks_s: Times of the marks, shape (K,), seconds from the start.
    """
    known = np.flatnonzero(np.isfinite(head).all(axis=1))
    first, last = int(known[0]), int(known[-1])
    # The drawing spans walk and robot.
    gap_m = _LABEL_GAP * float(np.max(np.ptp(np.append(head[known, :2], [[0.0, 0.0]], axis=0), axis=0)))
    texts = {first: "start", last: "end"}
    if np.linalg.norm(head[last, :2] - head[first, :2]) < gap_m:
        texts = {first: "start, end"}
    for tick, mark_s in zip(at[1:], marks_s[1:], strict=True):
        if all(np.linalg.norm(head[tick, :2] - head[other, :2]) >= gap_m for other in texts):
            texts[int(tick)] = f"{mark_s:.0f} s"
    for tick, text in texts.items():
        along = np.nan_to_num(head[min(tick + 10, last), :2] - head[max(tick - 10, first), :2])
        outward = head[tick, :2]
        normal = np.array([-along[1], along[0]])
        if np.linalg.norm(normal) < 0.01:  # standing: no direction of travel
            normal = outward
        if normal @ outward < 0:
            normal = -normal
        normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
        # The horizontal axis is y and points to the left.
        right, up = -normal[1], normal[0]
        ax.annotate(
            text,
            (head[tick, 1], head[tick, 0]),
            (10 * right, 10 * up),
            textcoords="offset points",
            ha="left" if right > 0.5 else "right" if right < -0.5 else "center",
            va="bottom" if up > 0.5 else "top" if up < -0.5 else "center",
            zorder=8,
        )
