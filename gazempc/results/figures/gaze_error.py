"""The gaze error over time, with the cones of eye contact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.head_and_body import HEAD_LINE, head_error_deg
from gazempc.results.figures.known import contact_shares, draw_known, finish, shown_head
from gazempc.results.figures.people import away_in_all
from gazempc.results.figures.style import CONTACT_COLOUR, DPI, Logs, readable, say, shade_unscored, styles
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg

_WIDTH = 8.0


def gaze_error(logs: Logs, path: Path) -> None:
    """Draw the gaze error over time with the contact cones and the share of eye contact.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    with readable(_WIDTH):
        figure = Figure(figsize=(_WIDTH, 5.6), dpi=DPI, layout="constrained")
        ax = figure.subplots()
        draw_gaze_error(ax, logs, detailed=True)
        cones = " / ".join(f"{cone:g}" for cone in CONTACT_DEG)
        known = any(np.isfinite(gaze_error_deg(log)).any() for log in logs.values())
        title = f"eye contact: share within {cones} deg" if known else None
        figure.legend(loc="outside lower center", ncols=2, frameon=False, title=title)
        finish(figure, logs, path)


def draw_gaze_error(ax: Axes, logs: Logs, *, detailed: bool) -> bool:
    """Draw the gaze error over time, the contact cones and the part that is not scored.

    The legend entries name the share of the scored window within each cone.

    Args:
        ax: Axes to draw on.
        logs: The runs.
        detailed: All cones, and tenths of degrees beside tens of them; else the main cone and a linear scale.

    Returns:
        Whether the error of the robot's head alone is drawn, too, as of a neck with eyes.
    """
    cones = CONTACT_DEG if detailed else CONTACT_DEG[:1]
    for inner, outer, alpha in zip((0.0, *cones), cones, (0.28, 0.16, 0.08), strict=False):
        ax.axhspan(inner, outer, color=CONTACT_COLOUR, alpha=alpha, lw=0)
        ax.text(1.01, outer, f"{outer:g}°", transform=ax.get_yaxis_transform(), va="center", color="#00664B")
    top, end_s = 0.0, 0.0
    looks, heads_alone = styles(logs), False
    for name, log in logs.items():
        look, head = looks[name], shown_head(log)
        shown = head.log if head.rare else log
        error, alone = gaze_error_deg(shown), head_error_deg(shown)
        time_s = log.time_s - log.time_s[0]
        if alone is not None and np.isfinite(alone).any():
            ax.plot(time_s, alone, color=look.colour, lw=1.1, ls=HEAD_LINE)
            top, heads_alone = max(top, float(np.nanmax(alone))), True
        if np.isfinite(error).any():
            draw_known(ax, time_s, error, head, color=look.colour, lw=look.width, label=_shares(look.label, log))
        top, end_s = max(top, float(np.nanmax(error, initial=0.0))), max(end_s, float(time_s[-1]))
    if heads_alone:
        ax.plot([], [], color="0.3", lw=1.1, ls=HEAD_LINE, label="of the robot's head alone")
    _say_if_unknown(ax, logs)
    shade_unscored(ax, end_s, away_in_all(logs))
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
    return heads_alone


def _say_if_unknown(ax: Axes, logs: Logs) -> None:
    """Say in the place of gaze errors why there are none."""
    if not any(np.isfinite(log.head_true_base_m).any() for log in logs.values()):
        why = "no gaze error: the true head is unknown"
    elif not any(np.isfinite(gaze_error_deg(log)).any() for log in logs.values()):
        why = "no gaze error: the joints were not read"
    else:
        return
    say(ax, why)


def _shares(label: str, log: Log) -> str:
    shares = contact_shares(log)
    if not np.isfinite(shares).all():
        return f"{label}: not known"
    return f"{label}: {' / '.join(f'{100 * share:.0f}' for share in shares)} %"
