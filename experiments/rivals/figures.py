"""Pictures: eye contact against acceleration, and against what is believed wrongly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter

from experiments.rivals.jobs import NAMES, OURS
from gazempc.results.figures.style import DPI, readable, style

Row = dict[str, Any]
# Colours that colour-blind people tell apart (Paul Tol's muted scheme); with the markers more rivals than there are.
_COLOURS = ("#332288", "#999933", "#882255", "#44AA99", "#117733", "#AA4499", "#DDCC77")
_MARKERS = "sD^v<>PX"
_TICKS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
# Rivals with less contact than this share one line of text.
_LITTLE = 0.01


def draw_contact(rows: Sequence[Row], trial: str, path: Path) -> None:
    """Eye contact against acceleration, every rival a point, a panel for each neck.

    Args:
        rows: Rows as of `experiments.rivals.plan.summarise`, of one sensor.
        trial: The trial that is shown.
        path: PNG file to write.
    """
    shown = [row for row in rows if row["trial"] == trial]
    necks = list(dict.fromkeys(row["neck"] for row in shown))
    width_inches = 2.2 + 3.8 * len(necks)
    with readable(width_inches):
        plot = Figure(figsize=(width_inches, 5.2), layout="constrained")
        panels = plot.subplots(1, len(necks), sharey=True, squeeze=False)[0]
        for ax, neck in zip(panels, necks, strict=True):
            _points(ax, [row for row in shown if row["neck"] == neck])
            ax.set_title(f"neck {neck}")
            ax.set_xlabel("RMS joint acceleration (rad/s$^2$)")
            ax.set_xscale("log")
            ax.xaxis.set_major_locator(FixedLocator(_TICKS))
            ax.xaxis.set_major_formatter("{x:g}")
            ax.xaxis.set_minor_formatter(NullFormatter())
            ax.grid(alpha=0.3, which="both")
        panels[0].set_ylabel("eye contact within 2.6 deg (% of the time)")
        handles, labels = panels[0].get_legend_handles_labels()
        plot.legend(handles, labels, loc="outside right center", fontsize="small")
        first = shown[0]
        plot.suptitle(f"{trial}: {first['n_clips']} walks of {first['n_people']} people, sensor {first['sensor']}")
        plot.savefig(path, dpi=DPI)


def colour_of(rival: str) -> str:
    """Colour of a control law, ours or another."""
    return style(rival).colour if rival in OURS else _COLOURS[NAMES.index(rival) % len(_COLOURS)]


def _points(ax: Axes, rows: Sequence[Row]) -> None:
    for row in rows:
        rival, ours = row["rival"], row["rival"] in OURS
        k = NAMES.index(rival)
        colour = colour_of(rival)
        x, y = row["rms_acceleration_rad_s2"], 100.0 * row["eye_contact_2p6"]
        if interval := row["eye_contact_2p6_ci95"]:
            ax.plot([x, x], [100.0 * end for end in interval], color=colour, lw=1.0)
        marker, size = ("o", 9) if ours else (_MARKERS[k % len(_MARKERS)], 6)
        ax.plot([x], [y], marker, color=colour, ms=size, label=f"ours: {rival}" if ours else rival)


def draw_wrong_model(panels: Mapping[str, Sequence[Row]], level: Sequence[Row], path: Path) -> None:
    """Eye contact against an error of the model; rivals without a model are level lines.

    Args:
        panels: Rows with ``rival``, ``by`` and ``eye_contact_2p6``, by the label of the error.
        level: Rows of rivals that have no model.
        path: PNG file to write.
    """
    width_inches = 4.6 * len(panels)
    with readable(width_inches):
        plot = Figure(figsize=(width_inches, 5.0), layout="constrained")
        axes = plot.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for ax, (label, rows) in zip(axes, panels.items(), strict=True):
            _level_lines(ax, level)
            for rival in dict.fromkeys(row["rival"] for row in rows):
                of_rival = sorted((row for row in rows if row["rival"] == rival), key=lambda row: float(row["by"]))
                look = style(rival)
                y = [100.0 * row["eye_contact_2p6"] for row in of_rival]
                ax.plot([row["by"] for row in of_rival], y, "o-", color=look.colour, label=look.label, ms=4)
            ax.set_xlabel(fill(label, 30))
            ax.grid(alpha=0.3)
        axes[0].set_ylabel("eye contact within 2.6 deg (% of the time)")
        # Free space in the middle panel, between the lowest curve and the lines of the other laws.
        axes[len(axes) // 2].legend(fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 0.12))
        plot.savefig(path, dpi=DPI)


def _level_lines(ax: Axes, level: Sequence[Row]) -> None:
    some = [row for row in level if row["eye_contact_2p6"] >= _LITTLE]
    for k, row in enumerate(some):
        y = 100.0 * row["eye_contact_2p6"]
        ax.axhline(y, color="0.6", lw=0.8)
        # Side by side: two lines may be nearer than a name is tall.
        at = (0.01 + 0.18 * (k % 5), y)
        ax.annotate(row["rival"], at, xycoords=("axes fraction", "data"), fontsize=6, va="bottom", color="0.4")
    if left := len(level) - len(some):
        ax.axhline(0.0, color="0.6", lw=0.8)
        text = f"{left} rivals without a model: below {100.0 * _LITTLE:g} %"
        ax.annotate(text, (0.01, -2.5), xycoords=("axes fraction", "data"), fontsize=6, va="top", color="0.4")
