"""Who was looked at over time, why, when the gaze looked away, and when there was contact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.known import finish
from gazempc.results.figures.people import draw_turns, person_colour, turns
from gazempc.results.figures.style import CONTACT_COLOUR, DPI, Logs, readable, styles
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg

_WIDTH = 8.0
# Letters that have room in the time line, and heights of the bars of a run: who is looked at, and below it contact.
_LETTERS = 75
_WHO, _CONTACT = 0.5, 0.18


def attended(logs: Logs, path: Path) -> None:
    """Draw a time line a run.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    with readable(_WIDTH):
        figure = Figure(figsize=(_WIDTH, 1.6 + 0.8 * len(logs)), dpi=DPI, layout="constrained")
        ax = figure.subplots()
        looks, end_s = styles(logs), 0.0
        for row, (_, log) in enumerate(logs.items()):
            draw_turns(ax, log, -float(row), _WHO, _LETTERS)
            _draw_contact(ax, log, -row - 0.5 * _WHO - _CONTACT)
            end_s = max(end_s, float(log.time_s[-1] - log.time_s[0]))
        ax.set_yticks([-float(row) for row in range(len(logs))], [looks[name].label for name in logs])
        ax.set(xlim=(0.0, end_s), ylim=(0.45 - len(logs), 0.4), xlabel="time (s)")
        numbers = sorted({turn.number for log in logs.values() for turn in turns(log)} - {0})
        legend = [Patch(color=person_colour(number), label=f"person {number}") for number in numbers]
        legend.append(Patch(facecolor="w", edgecolor="k", hatch="////", label="looks away"))
        if any(np.isfinite(gaze_error_deg(log)).any() for log in logs.values()):
            legend.append(Patch(color=CONTACT_COLOUR, label=f"contact (within {CONTACT_DEG[0]:g} deg)"))
        figure.legend(handles=legend, loc="outside lower center", ncols=4, frameon=False)
        finish(figure, logs, path)


def _draw_contact(ax: Axes, log: Log, at: float) -> None:
    start_s, end_s = float(log.time_s[0]), float(log.time_s[-1])
    contact = gaze_error_deg(log) <= CONTACT_DEG[0]
    edges = np.flatnonzero(np.diff(contact, prepend=False, append=False))
    times_s = np.append(log.time_s, end_s) - start_s
    spans = [(times_s[a], times_s[b] - times_s[a]) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    ax.broken_barh(spans, (at, _CONTACT), color=CONTACT_COLOUR, lw=0)
