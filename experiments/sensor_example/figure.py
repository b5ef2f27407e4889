"""Figures of what sensors saw of a walk, from above."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Ellipse

from experiments.sensor_example.seen import SHARE, Instant, SeenWalk
from gazempc.results.figures.style import COLOURS
from gazempc.results.log import FORECAST_HORIZONS_S
from gazempc.types import FloatArray

_TRUE, _FAINT = "0.25", "0.6"
_FORECAST, _SEEN = COLOURS[0], COLOURS[4]
# What the near view shows of the time before the instant, and room around that and the ellipses.
_PAST_S, _ROOM_M = 0.6, 0.12
_PANELS_A_ROW = 3
_DPI = 110
_LEGEND: dict[str, Any] = {"loc": "outside lower center", "ncols": 3, "frameon": False}


def draw_overview(all_seen: Sequence[SeenWalk], about: str, path: Path) -> None:
    """Draw the instant in the middle as each sensor saw it, on one scale.

    Args:
        all_seen: What each sensor saw of the same walk.
        about: Second line of the title.
        path: PNG file to write.
    """
    columns = min(len(all_seen), _PANELS_A_ROW)
    rows = -(-len(all_seen) // columns)
    clear = ConstrainedLayoutEngine(hspace=0.06)  # titles of a row are clear of the axis above
    figure = Figure(figsize=(3.9 * columns, 4.2 * rows + 1.1), layout=clear)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    window = _window(all_seen)
    for ax, seen in zip(axes, all_seen, strict=False):
        _draw_near(ax, seen, window)
        along_mm, across_mm = seen.error_rms_mm()
        ax.set_title(f"{seen.sensor}\nRMS {along_mm:.0f} mm along, {across_mm:.0f} mm across sight", fontsize="medium")
    for ax in axes[len(all_seen) :]:
        ax.set_axis_off()
    figure.legend(*axes[0].get_legend_handles_labels(), **_LEGEND)
    first = all_seen[0]
    figure.suptitle(f"{_walk_title(first)}, at {_middle(first).now_s:.1f} s\n{about}", fontsize="medium")
    figure.savefig(path, dpi=_DPI)


def _walk_title(seen: SeenWalk) -> str:
    group = f" ({seen.walk.labels.group})" if seen.walk.labels.group else ""
    data = " walk" if seen.walk.kind == "synthetic" else ""
    return f"{seen.walk.name}{group}, {seen.walk.kind}{data}"


def _middle(seen: SeenWalk) -> Instant:
    return seen.instants[len(seen.instants) // 2]


def _window(all_seen: Sequence[SeenWalk]) -> tuple[FloatArray, float]:
    """Middle, metres, and half the side of the square that holds path and ellipses around the instant."""
    points = []
    for seen in all_seen:
        instant = _middle(seen)
        points.append(seen.truth(instant.now_s + np.linspace(-_PAST_S, max(FORECAST_HORIZONS_S), 20))[:, :2])
        reach = instant.radius * np.sqrt(np.einsum("hii->hi", instant.covariances_m2))
        points += [instant.means_base_m - reach, instant.means_base_m + reach]
    low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
    return 0.5 * (low + high), 0.5 * float(np.max(high - low)) + _ROOM_M


def _draw_near(ax: Axes, seen: SeenWalk, window: tuple[FloatArray, float]) -> None:
    instant = _middle(seen)
    _draw_walk(ax, seen, dot=4.0)
    _draw_instant(ax, seen, instant, dot=6.0)
    (x_m, y_m), half_m = window
    ax.set_aspect("equal")
    ax.set_xlim(y_m + half_m, y_m - half_m)
    ax.set_ylim(x_m - half_m, x_m + half_m)


def _draw_walk(ax: Axes, seen: SeenWalk, dot: float) -> None:
    walked = seen.truth(np.linspace(0.0, float(seen.walk.times_s[-1]), 400))
    observed = seen.observed_base_m
    ax.plot(walked[:, 1], walked[:, 0], color=_TRUE, lw=1.5, zorder=4, label="true head")
    ax.plot(observed[:, 1], observed[:, 0], "o", color=_SEEN, ms=dot, mew=0, zorder=3, label="what the sensor saw")
    ax.set(xlabel="to the robot's left, y (m)", ylabel="ahead of the robot, x (m)")
    ax.grid(color="0.9", lw=0.6)
    ax.set_axisbelow(True)


def _draw_instant(ax: Axes, seen: SeenWalk, instant: Instant, dot: float) -> None:
    head = seen.truth([instant.now_s])[0]
    ax.plot([0.0, head[1]], [0.0, head[0]], ":", color=_FAINT, lw=1.2, zorder=1, label="line of sight")
    ax.plot(head[1], head[0], "D", color=_TRUE, ms=1.3 * dot, mec="w", mew=0.5, ls="", zorder=6, label="true head now")
    mean, true = instant.means_base_m, instant.true_base_m
    for covariance, at in zip(instant.covariances_m2, mean, strict=True):
        ax.add_patch(_ellipse(at, covariance, instant.radius))
    ax.plot([mean[:, 1], true[:, 1]], [mean[:, 0], true[:, 0]], color=_TRUE, lw=0.8, zorder=5)
    then = "true head 0.25, 0.5 and 1 s later"
    ax.plot(true[:, 1], true[:, 0], "o", mfc="w", mec=_TRUE, mew=1.2, ms=1.5 * dot, ls="", zorder=5, label=then)
    said = f"its forecast, with the stated {100 * SHARE:.0f} %"
    ax.plot(mean[:, 1], mean[:, 0], "o", color=_FORECAST, ms=dot, mew=0, ls="", zorder=6, label=said)


def _ellipse(mean_m: FloatArray, covariance_m2: FloatArray, radius: float) -> Ellipse:
    values, vectors = np.linalg.eigh(covariance_m2)
    short, long = 2.0 * radius * np.sqrt(np.maximum(values, 0.0))
    # The horizontal axis is y, the vertical one x.
    angle_deg = float(np.degrees(np.arctan2(vectors[0, 1], vectors[1, 1])))
    look: dict[str, Any] = {"fc": (_FORECAST, 0.15), "ec": (_FORECAST, 0.8), "lw": 1.0, "zorder": 2}
    return Ellipse((mean_m[1], mean_m[0]), long, short, angle=angle_deg, **look)
