"""Figures of a run, drawn from the logs alone.

All functions take ``logs``: controller name -> log of the same recording, in the order in which they are shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from gazempc.neck.kinematics import gaze_ray, look_at, unwrap_pan
from gazempc.results.log import Log
from gazempc.results.metrics import CONTACT_DEG, SCORED_FROM_S, gaze_error_deg, measure
from gazempc.results.report import LABELS
from gazempc.types import FloatArray

Logs = Mapping[str, Log]

CONTACT_COLOUR = "#009E73"
_DPI = 150
_UNSCORED = "0.92"
_RAYS_AT_MOST = 5
# Labels need about this share of the drawing in the overview.
_LABEL_GAP = 0.1
_LIMIT_NEAR_DEG = 10.0


@dataclass(frozen=True)
class Style:
    """How a controller looks in every figure.

    Attributes:
        label: Name for people.
        colour: Colour that colour-blind people can tell apart too (Okabe and Ito).
        width: Line width, points; thinner lines are drawn over wider ones, so that both show where they meet.
    """

    label: str
    colour: str
    width: float


_STYLES = {
    "reactive": Style(LABELS["reactive"], "#D55E00", 2.0),
    "lookahead": Style(LABELS["lookahead"], "#56B4E9", 2.8),
    "mpc": Style(LABELS["mpc"], "#0072B2", 1.6),
    "perfect": Style(LABELS["perfect"], "#CC79A7", 1.6),
}


def style(controller: str) -> Style:
    """Look of a controller; one that is not among the built-in ones is grey and keeps its name."""
    return _STYLES.get(controller, Style(controller, "0.4", 1.6))


def recording_title(logs: Logs) -> str:
    """Name and origin of the recording, such as ``subject03_R4 (turn), synthetic data``."""
    run = next(iter(logs.values())).run
    group = f" ({run.group})" if run.group else ""
    data = " data" if run.kind == "synthetic" else ""
    return f"{run.recording}{group}, {run.kind}{data}"


def setup_title(logs: Logs) -> str:
    """Predictor, neck, sensor and seed of the runs; the perfect forecast is named by its controller's label."""
    runs = [log.run for log in logs.values()]
    predictors = dict.fromkeys(run.predictor for run in runs if run.controller != "perfect")
    neck, sensor, seed = runs[0].neck.name, runs[0].sensor["name"], runs[0].seed
    return f"predictor {', '.join(predictors) or 'perfect'}; neck {neck}; sensor {sensor}; seed {seed}"


def draw_birds_eye(ax: Axes, logs: Logs) -> None:
    """Draw the walk from above, the robot, and where each controller's gaze was at some instants.

    A gaze ray ends as far from the eye as the head is; a dotted line joins its end to the head at that time.
    The robot looks up the page and its left is on the left.

    Args:
        ax: Axes to draw on.
        logs: The runs.
    """
    first = next(iter(logs.values()))
    time_s, head = first.time_s - first.time_s[0], first.head_true_base_m
    end_s = float(time_s[-1])
    ax.set_aspect("equal", adjustable="datalim")
    ax.plot(head[:, 1], head[:, 0], color="0.25", lw=1.5, zorder=4, label="true head")
    marks_s = np.arange(0.0, end_s + 1e-6)
    at = np.searchsorted(time_s, marks_s - 1e-6)
    # Rings, because the tip of a good gaze lies on the head and would hide a dot.
    ax.plot(head[at, 1], head[at, 0], "o", mfc="w", mec="0.25", mew=1.5, ms=11, ls="", zorder=5, label="each second")

    rays_s = marks_s[marks_s >= SCORED_FROM_S] if end_s >= SCORED_FROM_S else np.array([end_s])
    chosen = np.linspace(0, len(rays_s) - 1, min(len(rays_s), _RAYS_AT_MOST)).round().astype(int)
    for name, log in logs.items():
        look = style(name)
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


def draw_gaze_error(ax: Axes, logs: Logs, *, detailed: bool) -> None:
    """Draw the gaze error over time, the contact cones and the part that is not scored.

    The legend entries name the share of the scored window within each cone.

    Args:
        ax: Axes to draw on.
        logs: The runs.
        detailed: All cones, and tenths of degrees beside tens of them; else the main cone and a linear scale.
    """
    cones = CONTACT_DEG if detailed else CONTACT_DEG[:1]
    for inner, outer, alpha in zip((0.0, *cones), cones, (0.28, 0.16, 0.08), strict=False):
        ax.axhspan(inner, outer, color=CONTACT_COLOUR, alpha=alpha, lw=0)
        ax.text(1.01, outer, f"{outer:g}°", transform=ax.get_yaxis_transform(), va="center", color="#00664B")
    top, end_s = 0.0, 0.0
    for name, log in logs.items():
        look, error = style(name), gaze_error_deg(log)
        ax.plot(log.time_s - log.time_s[0], error, color=look.colour, lw=look.width, label=_shares(name, log))
        top, end_s = max(top, float(error.max())), max(end_s, float(log.time_s[-1] - log.time_s[0]))
    _shade_unscored(ax, end_s)
    ax.set(xlim=(0.0, end_s), ylim=(0.0, max(1.05 * top, 8.0)), xlabel="time (s)", ylabel="gaze error (deg)")
    if detailed:
        # On a logarithmic scale each passage through zero would be a spike of no meaning.
        ax.set_yscale("function", functions=(lambda v: np.sqrt(np.maximum(v, 0.0)), np.square))
        top = max(1.1 * top, 10.0)
        ticks = [0.0]
        for tick in (0.1, 0.5, 1, 2, 3, 5, 10, 15, 20, 30, 50, 100, 150):
            if np.sqrt(tick) - np.sqrt(ticks[-1]) > 0.05 * np.sqrt(top):
                ticks.append(tick)
        ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        ax.set(ylim=(0.0, top), ylabel="gaze error (deg, square-root scale)")
        ax.grid(axis="y", color="0.85", lw=0.6)


def birds_eye(logs: Logs, path: Path) -> None:
    """Draw the walk from above with the gaze rays of each controller.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    figure = Figure(figsize=(7.2, 6.6), dpi=_DPI, layout="constrained")
    ax = figure.subplots()
    draw_birds_eye(ax, logs)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    _finish(figure, logs, path)


def angles(logs: Logs, path: Path) -> None:
    """Draw pan and tilt over time: target, command and joint, one column for each controller.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    figure = Figure(figsize=(max(2.0 + 2.7 * len(logs), 6.4), 5.6), dpi=_DPI, layout="constrained")
    axes = figure.subplots(2, len(logs), sharex=True, sharey="row", squeeze=False)
    limits_shown = False
    for column, (name, log) in zip(axes.T, logs.items(), strict=True):
        time_s = log.time_s - log.time_s[0]
        neck, look = log.neck, style(name)
        targets = unwrap_pan(
            look_at(neck.geometry, log.head_true_base_m).angles_rad,
            float(log.joint_position_rad[0, 0]),
            float(neck.position_min_rad[0]),
            float(neck.position_max_rad[0]),
        )
        limits_deg = np.rad2deg([neck.position_min_rad, neck.position_max_rad])
        for axis, ax in enumerate(column):
            curves = np.rad2deg([targets[:, axis], log.command_position_rad[:, axis], log.joint_position_rad[:, axis]])
            _shade_unscored(ax, float(time_s[-1]))
            ax.plot(time_s, curves[0], color="k", lw=2.6, alpha=0.35)
            ax.plot(time_s, curves[1], color=look.colour, lw=1.3, ls=(0, (4, 1.5)))
            ax.plot(time_s, curves[2], color=look.colour, lw=1.8)
            for limit in limits_deg[:, axis]:
                if curves.min() - _LIMIT_NEAR_DEG <= limit <= curves.max() + _LIMIT_NEAR_DEG:
                    ax.axhline(limit, color="k", lw=1.2, ls=":")
                    limits_shown = True
            ax.grid(color="0.9", lw=0.6)
        column[0].set_title(look.label)
        column[1].set_xlabel("time (s)")
    axes[0, 0].set(ylabel="pan, left + (deg)", xlim=(0.0, float(time_s[-1])))
    axes[1, 0].set_ylabel("tilt, up + (deg)")
    # The legend shows kinds of line in a neutral colour, because the colour says which controller it is.
    key = axes[0, 0]
    key.plot([], [], color="k", lw=2.6, alpha=0.35, label="target: true head")
    key.plot([], [], color="0.3", lw=1.3, ls=(0, (4, 1.5)), label="command sent")
    key.plot([], [], color="0.3", lw=1.8, label="joint")
    if limits_shown:
        key.plot([], [], color="k", lw=1.2, ls=":", label="joint limit")
    figure.legend(
        *key.get_legend_handles_labels(), loc="outside lower center", ncols=5 if len(logs) > 2 else 3, frameon=False
    )
    _finish(figure, logs, path)


def gaze_error(logs: Logs, path: Path) -> None:
    """Draw the gaze error over time with the contact cones and the share of eye contact.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    figure = Figure(figsize=(8.0, 5.6), dpi=_DPI, layout="constrained")
    ax = figure.subplots()
    draw_gaze_error(ax, logs, detailed=True)
    cones = " / ".join(f"{cone:g}" for cone in CONTACT_DEG)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, title=f"eye contact: share within {cones} deg")
    _finish(figure, logs, path)


def _finish(figure: Figure, logs: Logs, path: Path) -> None:
    figure.suptitle(f"{recording_title(logs)}\n{setup_title(logs)}", fontsize="medium")
    figure.savefig(path, dpi=_DPI)


def _shares(name: str, log: Log) -> str:
    figures = measure(log)
    shares = (figures.eye_contact_2p6, figures.eye_contact_4, figures.eye_contact_9)
    return f"{style(name).label}: {' / '.join(f'{100 * share:.0f}' for share in shares)} %"


def _shade_unscored(ax: Axes, end_s: float) -> None:
    ax.axvspan(0.0, min(SCORED_FROM_S, end_s), color=_UNSCORED, lw=0, zorder=0.5, label="not scored")


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
