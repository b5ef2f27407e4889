"""The walk from above, with the gaze rays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from gazempc.neck.kinematics import gaze_ray
from gazempc.results.figures.known import draw_known, finish, shown_head
from gazempc.results.figures.style import DPI, Logs, style
from gazempc.results.metrics import SCORED_FROM_S
from gazempc.types import FloatArray

_RAYS_AT_MOST = 5
# Labels need about this share of the drawing in the overview.
_LABEL_GAP = 0.1


def birds_eye(logs: Logs, path: Path) -> None:
    """Draw the walk from above with the gaze rays of each controller.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    figure = Figure(figsize=(7.2, 6.6), dpi=DPI, layout="constrained")
    ax = figure.subplots()
    draw_birds_eye(ax, logs)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    finish(figure, logs, path)


def draw_birds_eye(ax: Axes, logs: Logs) -> None:
    """Draw the walk from above, the robot, and where each controller's gaze was at some instants.

    A gaze ray ends as far from the eye as the head is; a dotted line joins its end to the head at that time.
    The robot looks up the page and its left is on the left.

    Args:
        ax: Axes to draw on.
        logs: The runs.
    """
    heads = {name: shown_head(log) for name, log in logs.items()}
    shown = next(iter(heads.values()))
    time_s, head = shown.log.time_s - shown.log.time_s[0], shown.log.head_true_base_m
    end_s = float(time_s[-1])
    ax.set_aspect("equal", adjustable="datalim")
    draw_known(ax, head[:, 1], head[:, 0], shown, color="0.25", lw=1.5, zorder=4, label=shown.label)
    marks_s = np.arange(0.0, end_s + 1e-6)
    at = np.searchsorted(time_s, marks_s - 1e-6)
    # Rings, because the tip of a good gaze lies on the head and would hide a dot.
    ax.plot(head[at, 1], head[at, 0], "o", mfc="w", mec="0.25", mew=1.5, ms=11, ls="", zorder=5, label="each second")

    rays_s = marks_s[marks_s >= SCORED_FROM_S] if end_s >= SCORED_FROM_S else np.array([end_s])
    chosen = np.linspace(0, len(rays_s) - 1, min(len(rays_s), _RAYS_AT_MOST)).round().astype(int)
    for name, each in heads.items():
        look, log = style(name), each.log
        tick = np.searchsorted(log.time_s, log.time_s[0] + rays_s[chosen] - 1e-6)
        eye, direction = gaze_ray(log.neck.geometry, log.joint_position_rad[tick])
        reach = np.linalg.norm(log.head_true_base_m[tick] - eye, axis=1, keepdims=True)
        tip = eye + reach * direction
        ax.plot([eye[:, 1], tip[:, 1]], [eye[:, 0], tip[:, 0]], color=look.colour, lw=0.5 * look.width)
        missed = np.stack([tip, log.head_true_base_m[tick]])
        ax.plot(missed[..., 1], missed[..., 0], color=look.colour, lw=1.0, ls=":")
        ax.plot(tip[:, 1], tip[:, 0], "D", color=look.colour, ms=5.5, mec="w", mew=0.5, zorder=6)
        ax.plot([], [], "D-", color=look.colour, ms=5.5, lw=0.5 * look.width, label=f"gaze, {look.label}")

    _label_times(ax, head, at, marks_s)
    ax.add_patch(FancyArrowPatch((0, 0), (0, 0.55), arrowstyle="-|>", mutation_scale=16, lw=2.5, fc="k", zorder=7))
    ax.plot(0, 0, "o", color="k", ms=11, zorder=7)
    ax.annotate("robot", (0, 0), (12, -3), textcoords="offset points", va="center")
    # Room for labels beside the path. Margins would not do, because equal aspect may take them away again.
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
    """Name start, end and the seconds that have room, beside the path on the side away from the robot.

    Args:
        ax: Axes to draw on.
        head: True head, shape (M, 3), metres.
        at: Ticks of the marks, shape (K,).
        marks_s: Times of the marks, shape (K,), seconds from the start.
    """
    last = len(head) - 1
    # The drawing spans walk and robot.
    gap_m = _LABEL_GAP * float(np.max(np.ptp(np.append(head[:, :2], [[0.0, 0.0]], axis=0), axis=0)))
    texts = {0: "start", last: "end"}
    if np.linalg.norm(head[last, :2] - head[0, :2]) < gap_m:
        texts = {0: "start, end"}
    for tick, mark_s in zip(at[1:], marks_s[1:], strict=True):
        if all(np.linalg.norm(head[tick, :2] - head[other, :2]) >= gap_m for other in texts):
            texts[int(tick)] = f"{mark_s:.0f} s"
    for tick, text in texts.items():
        along = head[min(tick + 10, last), :2] - head[max(tick - 10, 0), :2]
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
