"""Directions of the robot's head and body, and a partly unknown person's head, for figures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gazempc.files.whole import naming
from gazempc.neck.kinematics import gaze_ray, head_angles_rad
from gazempc.recordings.recording import truth_of
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.style import DPI, Logs, recording_title, setup_title
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg, scored_ticks
from gazempc.types import BoolArray, FloatArray

# Line styles of parts that deviate from the gaze; colour denotes the controller.
HEAD_LINE: Any = (0, (6, 1.5, 1.5, 1.5))
_BODY_LINE: Any = (0, (1.5, 1.5))


@dataclass(frozen=True)
class Part:
    """A direction beside the gaze.

    Attributes:
        label: Display name.
        direction: Unit vector in the base frame at each tick, shape (M, 3); NaN if unknown.
        line: Line style of matplotlib.
        line_name: Name of the line style.
        level: Whether it rotates about the vertical only.
    """

    label: str
    direction: FloatArray
    line: Any
    line_name: str
    level: bool


def parts(log: Log) -> tuple[Part, ...]:
    """The parts that deviate from the gaze.

    Args:
        log: The run.

    Returns:
        Head of a neck with eyes, and a turning body; empty for pan and tilt.
    """
    neck, joints = log.neck, log.joint_position_rad
    found = []
    if neck.eyes is not None:
        _, direction = gaze_ray(neck.geometry, head_angles_rad(joints))
        found.append(Part("robot's head", direction, HEAD_LINE, "dashed", level=False))
    if neck.body is not None:
        yaw = joints[:, neck.joint_names.index("body_yaw")]
        forward = np.stack([np.cos(yaw), np.sin(yaw), 0.0 * yaw], axis=-1)
        found.append(Part("robot's body", forward, _BODY_LINE, "dotted", level=True))
    return tuple(found)


def head_alone(log: Log) -> Log | None:
    """The run with centred eyes, for the error of the head alone; None for a neck without eyes."""
    if log.neck.eyes is None:
        return None
    plain = log.neck.model_copy(update={"eyes": None, "body": None})
    run = log.run.model_copy(update={"neck": plain})
    return replace(log, run=run, joint_position_rad=head_angles_rad(log.joint_position_rad))


# Size of an isolated point, points.
_POINT = 4.0


@dataclass(frozen=True)
class ShownHead:
    """The head as figures show it.

    Attributes:
        log: The run, with a head that is interpolated between rare frames, or, where the true one is unknown,
            between observations.
        known: Ticks with a known true head, shape (M,).
        rare: Whether the frame rate is so low that it is known at isolated ticks only.
        label: Name in a legend.
    """

    log: Log
    known: BoolArray
    rare: bool
    label: str


def shown_head(log: Log) -> ShownHead:
    """The head as figures show it.

    Args:
        log: The run.

    Returns:
        The head; NaN where it is neither known nor interpolated.
    """
    known = np.asarray(np.isfinite(log.head_true_base_m).all(axis=1))
    if not known.any():
        heads_m = _joined(log.time_s, log.capture_time_s, log.head_observed_base_m)
        return ShownHead(replace(log, head_true_base_m=heads_m), known, False, "head as observed")
    label = "smoothed track" if truth_of(log.run.kind) else "true head"
    # A single frame between two gaps is not a low frame rate.
    alone = known & (np.convolve(known, [1, 0, 1], "same") == 0)
    rare = 2 * np.count_nonzero(alone) > np.count_nonzero(known)
    if not rare:
        return ShownHead(log, known, False, label)
    heads_m = _joined(log.time_s, log.time_s[known], log.head_true_base_m[known])
    return ShownHead(replace(log, head_true_base_m=heads_m), known, True, label)


def draw_known(ax: Axes, x: FloatArray, y: FloatArray, head: ShownHead, **look: Any) -> None:
    """Draw a curve computed from the head; for a low frame rate as points with dots between them.

    Args:
        ax: Axes to draw on.
        x: Shape (M,).
        y: Shape (M,).
        head: The head.
        **look: Arguments of matplotlib's `plot`.
    """
    if head.rare:
        ax.plot(x[head.known], y[head.known], **(look | {"ls": "", "marker": "o", "ms": _POINT}))
        look |= {"lw": 0.8, "ls": ":", "label": None}
    ax.plot(x, y, **look)


def running_contact(log: Log) -> FloatArray:
    """Share of the scored window up to each tick with eye contact.

    Args:
        log: The run.

    Returns:
        Shares, shape (M,); NaN before the window begins. The last one is the eye contact of `measure`.
    """
    error_deg = gaze_error_deg(log)
    scored = scored_ticks(log, error_deg)
    ticks = np.cumsum(scored)
    return np.where(ticks > 0, np.cumsum(scored & (error_deg <= CONTACT_DEG[0])) / np.maximum(ticks, 1), np.nan)


def known_title(logs: Logs) -> str:
    """Note on the head in a figure; empty where it is known throughout."""
    head = shown_head(next(iter(logs.values())))
    if not head.known.any():
        return "live run: the true head is unknown"
    if head.rare:
        every_s = float(np.median(np.diff(head.log.time_s[head.known])))
        return f"frames {every_s:.2f} s apart: the true head is known at the points only, and scored there"
    return ""


def finish(figure: Figure, logs: Logs, path: Path) -> None:
    """Add the runs' title to a figure, and write it.

    Args:
        figure: The figure.
        logs: The runs.
        path: Picture to write.
    """
    lines = filter(None, (recording_title(logs), setup_title(logs), known_title(logs)))
    figure.suptitle("\n".join(lines), fontsize="medium")
    with naming(path):
        figure.savefig(path, dpi=DPI)


def _joined(times_s: FloatArray, at_s: FloatArray, positions_m: FloatArray) -> FloatArray:
    """Straight lines from point to point, shape (M, 3); NaN before the first and after the last one."""
    if not at_s.size:
        return np.full((times_s.size, 3), np.nan)
    order = np.argsort(at_s)  # the first frames of a track may be out of order
    return np.stack([np.interp(times_s, at_s[order], axis, np.nan, np.nan) for axis in positions_m[order].T], axis=1)
