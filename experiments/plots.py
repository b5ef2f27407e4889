"""Plots with confidence intervals over people: PNG files by Matplotlib, and charts of the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from gazempc.results.figures.style import COLOURS, DPI, readable
from gazempc.results.page.content import Chart, Curve
from gazempc.types import FloatArray

# Dashes and gaps of lines that share a colour, such as those of predictors or necks, and their markers.
_GAPS = ((4, 1.5), (1, 1.2), (6, 1.5, 1, 1.5), (8, 3), (3, 1, 1, 1, 1, 1), (2, 3), (10, 2, 2, 2))
_LINES: tuple[Any, ...] = ("-", *((0, gaps) for gaps in _GAPS))
_MARKERS = "os^DvP*X"


@dataclass(frozen=True)
class Line(Curve):
    """A curve of a report, with further data for the PNG file.

    Attributes:
        ends: Lower and upper ends of the intervals of y, shape (N, 2); NaN or None if absent.
        beside: Further points, shape (M, 2), drawn faintly without a line.
    """

    ends: FloatArray | None = None
    beside: FloatArray | None = None


@dataclass(frozen=True)
class Plot(Chart):
    """A chart of a report, with further data for the PNG file.

    Attributes:
        curves: The lines.
        legend: Title of the legend.
        ticks: Category names at 0, 1, ...; empty for a numeric axis.
    """

    curves: tuple[Line, ...]
    legend: str = ""
    ticks: tuple[str, ...] = ()


def draw(
    plots: Sequence[Plot], path: Path, about: str, *, rows: int = 1, log_x: bool = False, log_y: bool = False
) -> None:
    """Draw plots as panels with a shared y axis and legend.

    Args:
        plots: One per panel, all with the same lines.
        path: PNG file to write.
        about: Description of the data.
        rows: Number of rows of panels.
        log_x: Whether the x axis is logarithmic.
        log_y: Whether the y axis is logarithmic.
    """
    single, columns = len(plots) == 1, len(plots) // rows
    width_inches = 7.0 if single else 3.0 * columns + 2.4
    with readable(width_inches):
        figure = Figure(figsize=(width_inches, 4.4 if single else 3.6 * rows), layout="constrained")
        panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
        for ax, plot in zip(panels.flat, plots, strict=True):
            for i, line in enumerate(plot.curves):
                _draw_line(ax, line, i, plot)
            if plot.ticks:
                ax.set_xticks(range(len(plot.ticks)), plot.ticks)
            ax.set_title(plot.title, fontsize="medium")
            ax.set_xlabel(plot.x_label)
            ax.set_yscale("log" if log_y else "linear")
            if log_x:
                ax.set_xscale("log")
                ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                ax.xaxis.set_major_formatter("{x:g}")
                ax.xaxis.set_minor_formatter(NullFormatter())
            ax.grid(alpha=0.3, which="both")
        for ax in panels[:, 0]:
            ax.set_ylabel(plots[0].y_label)
        if single:
            panels[0, 0].legend(framealpha=0.85, edgecolor="none", fontsize="small", title=plots[0].legend)
        else:
            handles, labels = panels[0, 0].get_legend_handles_labels()
            # At the right: a legend of many columns would be wider than the figure.
            figure.legend(handles, labels, loc="outside right center", frameon=False, fontsize="small")
        figure.supxlabel(about, fontsize="small", color="0.4")
        figure.savefig(path, dpi=DPI)


def _draw_line(ax: Axes, line: Line, index: int, plot: Plot) -> None:
    dashes, shape = _LINES[index % len(_LINES)], _MARKERS[index % len(_MARKERS)]
    # Horizontal offset within a category, so that intervals do not overlap.
    x = line.x + (0.12 * (index - (len(plot.curves) - 1) / 2) if plot.ticks else 0.0)
    style = "" if plot.ticks or len(line.x) == 1 else dashes
    marker = "" if line.ends is None and line.beside is None else shape
    ax.plot(x, line.y, ls=style, marker=marker, ms=4, color=line.colour, label=line.label)
    if line.beside is not None:
        ax.plot(*line.beside.T, ls="", marker=shape, ms=4, color=line.colour, alpha=0.35)
    if line.ends is not None:
        ax.vlines(x, *line.ends.T, color=line.colour, lw=1.0)


def points(
    rows: Mapping[str, Mapping[str, Any]], x: str, y: str, factor: float, colours: Mapping[str, str]
) -> tuple[Line, ...]:
    """One point per row, with its vertical interval.

    Args:
        rows: Means by label; the interval of `y` is under ``<y>_ci95``.
        x: Metric of the horizontal axis.
        y: Metric of the vertical axis.
        factor: Scale factor of the vertical axis.
        colours: CSS colour by label; default: by index.
    """
    lines = []
    for k, (label, row) in enumerate(rows.items()):
        ends = factor * np.array([row[f"{y}_ci95"] or (np.nan, np.nan)])
        at, height = np.array([row[x]]), factor * np.array([row[y]])
        lines.append(Line(label, colours.get(label, COLOURS[k % len(COLOURS)]), at, height, ends=ends))
    return tuple(lines)


def share_of_clips(title: str, x_label: str, clips: Mapping[tuple[str, str], Mapping[str, float]]) -> Plot:
    """Empirical cumulative distribution of an error over clips.

    Args:
        title: Title.
        x_label: Name and unit of the error.
        clips: Error by clip, for each label and its CSS colour.

    Returns:
        The plot; a line farther left is better.
    """
    lines = []
    for (label, colour), of_clip in clips.items():
        names = tuple(sorted(of_clip, key=of_clip.__getitem__))
        percent = 100.0 * np.arange(1, len(names) + 1) / max(len(names), 1)
        errors = np.array([of_clip[name] for name in names], dtype=np.float64)
        lines.append(Line(label, colour, errors, percent, names=names))
    return Plot(title, x_label, "share of clips (%)", tuple(lines))
