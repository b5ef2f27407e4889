"""Who was looked at over time, why, when the gaze looked away, and when there was contact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.known import finish
from gazempc.results.figures.style import COLOURS, CONTACT_COLOUR, DPI, Logs, readable, styles
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg

_WIDTH = 8.0
# Heights of the bars of a run: who is looked at, and below it contact.
_WHO, _CONTACT = 0.5, 0.18
_NOBODY = "0.85"


def has_attention(logs: Logs) -> bool:
    """Whether there is anything to draw: somebody was chosen, or looked away from.

    Args:
        logs: The runs.
    """
    return any(log.attended_time_s.size or log.away_start_s.size for log in logs.values())


def attended(logs: Logs, path: Path) -> None:
    """Draw a time line a run.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    with readable(_WIDTH):
        figure = Figure(figsize=(_WIDTH, 1.6 + 0.9 * len(logs)), dpi=DPI, layout="constrained")
        ax = figure.subplots()
        looks, end_s = styles(logs), 0.0
        for row, (_, log) in enumerate(logs.items()):
            _draw_run(ax, log, -float(row))
            end_s = max(end_s, float(log.time_s[-1] - log.time_s[0]))
        ax.set_yticks([-float(row) for row in range(len(logs))], [looks[name].label for name in logs])
        ax.set(xlim=(0.0, end_s), ylim=(0.45 - len(logs), 0.6), xlabel="time (s)")
        numbers = sorted({int(number) for log in logs.values() for number in log.attended_person if number})
        legend = [Patch(color=_colour(number), label=f"person {number}") for number in numbers]
        legend.append(Patch(facecolor="w", edgecolor="k", hatch="////", label="looks away"))
        legend.append(Patch(color=CONTACT_COLOUR, label=f"contact (within {CONTACT_DEG[0]:g} deg)"))
        figure.legend(handles=legend, loc="outside lower center", ncols=4, frameon=False)
        finish(figure, logs, path)


def _draw_run(ax: Axes, log: Log, at: float) -> None:
    start_s, end_s = float(log.time_s[0]), float(log.time_s[-1])
    # One person all the time is nobody's choice.
    changes = list(
        zip(log.attended_time_s.tolist(), log.attended_person.tolist(), log.attended_why.tolist(), strict=True)
    )
    changes = changes or [(start_s, 1, "")]
    for (from_s, number, why), to_s in zip(changes, [*(each[0] for each in changes[1:]), end_s], strict=True):
        ax.barh(at, to_s - from_s, _WHO, from_s - start_s, color=_colour(number), lw=0)
        ax.text(from_s - start_s, at + 0.5 * _WHO, f" {why}", va="bottom", ha="left", fontsize="small")
    for from_s, to_s in zip(log.away_start_s.tolist(), log.away_end_s.tolist(), strict=True):
        lasts_s = min(to_s, end_s) - from_s
        ax.barh(at, lasts_s, _WHO, from_s - start_s, facecolor=(1, 1, 1, 0.6), edgecolor="k", hatch="////", lw=0.6)
    contact = gaze_error_deg(log) <= CONTACT_DEG[0]
    edges = np.flatnonzero(np.diff(contact, prepend=False, append=False))
    times_s = np.append(log.time_s, end_s) - start_s
    spans = [(times_s[a], times_s[b] - times_s[a]) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    ax.broken_barh(spans, (at - 0.5 * _WHO - _CONTACT, _CONTACT), color=CONTACT_COLOUR, lw=0)


def _colour(number: int) -> str:
    """Of a person; contact has a colour of its own."""
    choices = [colour for colour in COLOURS if colour != CONTACT_COLOUR]
    return choices[(number - 1) % len(choices)] if number else _NOBODY
