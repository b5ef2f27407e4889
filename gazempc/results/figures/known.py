"""What figures draw of a head that is not known at every tick: of rare frames, or of a live run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gazempc.errors import LeftOutError
from gazempc.recordings.recording import truth_of
from gazempc.results.figures.style import DPI, Logs, recording_title, setup_title
from gazempc.results.log import Log
from gazempc.results.metrics import measure
from gazempc.types import BoolArray, FloatArray

# So large is a point that stands alone, points.
_POINT = 4.0


@dataclass(frozen=True)
class ShownHead:
    """The head as figures show it.

    Attributes:
        log: The run, with a head that is interpolated between rare frames, or, where the true one is unknown,
            between observations.
        known: At which ticks the true head is known, shape (M,).
        rare: Whether it is known at single ticks only, because the frames are far apart.
        label: What it is, for a legend.
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
        The head; NaN where it is neither known nor between two points that are.
    """
    known = np.asarray(np.isfinite(log.head_true_base_m).all(axis=1))
    if not known.any():
        heads_m = _joined(log.time_s, log.capture_time_s, log.head_observed_base_m)
        return ShownHead(replace(log, head_true_base_m=heads_m), known, False, "head as observed")
    label = "smoothed track" if truth_of(log.run.kind) else "true head"
    # A single frame between two gaps does not make a walk of rare frames.
    rare = 2 * np.count_nonzero(_alone(known)) > np.count_nonzero(known)
    if not rare:
        return ShownHead(log, known, False, label)
    heads_m = _joined(log.time_s, log.time_s[known], log.head_true_base_m[known])
    return ShownHead(replace(log, head_true_base_m=heads_m), known, True, label)


def draw_known(ax: Axes, x: FloatArray, y: FloatArray, head: ShownHead, **look: Any) -> None:
    """Draw a curve that follows from the head; of rare frames points, and dots between them.

    Args:
        ax: Axes to draw on.
        x: Shape (M,).
        y: Shape (M,).
        head: The head.
        **look: What matplotlib's `plot` takes.
    """
    if not head.rare:
        ax.plot(x, y, **look)
        return
    ax.plot(x, y, **(look | {"lw": 0.8, "ls": ":", "label": None}))
    alone = _alone(head.known)
    ax.plot(x, np.where(head.known & ~alone, y, np.nan), **(look | {"label": None}))
    ax.plot(x[alone], y[alone], **(look | {"ls": "", "marker": "o", "ms": _POINT}))


def contact_shares(log: Log) -> tuple[float, float, float]:
    """Shares of the scored window with eye contact, for the three cones; NaN where nothing can be scored."""
    try:
        found = measure(log)
    except LeftOutError:
        return (np.nan, np.nan, np.nan)
    return found.eye_contact_2p6, found.eye_contact_4, found.eye_contact_9


def known_title(logs: Logs) -> str:
    """What a reader must know of the head in a figure; empty where it is known throughout."""
    head = shown_head(next(iter(logs.values())))
    if not head.known.any():
        return "live run: the true head is unknown"
    if head.rare:
        every_s = float(np.median(np.diff(head.log.time_s[head.known])))
        return f"frames {every_s:.2f} s apart: the true head is known at the points only, and scored there"
    return ""


def finish(figure: Figure, logs: Logs, path: Path) -> None:
    """Title a figure by its runs, and write it.

    Args:
        figure: The figure.
        logs: The runs.
        path: Picture to write.
    """
    lines = filter(None, (recording_title(logs), setup_title(logs), known_title(logs)))
    figure.suptitle("\n".join(lines), fontsize="medium")
    figure.savefig(path, dpi=DPI)


def _alone(known: BoolArray) -> BoolArray:
    beside = np.zeros_like(known)
    beside[1:] |= known[:-1]
    beside[:-1] |= known[1:]
    return known & ~beside


def _joined(times_s: FloatArray, at_s: FloatArray, positions_m: FloatArray) -> FloatArray:
    """Straight lines from point to point, shape (M, 3); NaN before the first and after the last one."""
    if not at_s.size:
        return np.full((times_s.size, 3), np.nan)
    order = np.argsort(at_s)  # the first frames of a track may have come out of order
    return np.stack([np.interp(times_s, at_s[order], axis, np.nan, np.nan) for axis in positions_m[order].T], axis=1)
