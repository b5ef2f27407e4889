"""The overview of a run: the walk from above, the gaze error over time and the eye contact; the attended person."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.text import Text

from gazempc.files.whole import naming
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures import known, people, style
from gazempc.results.figures.birds_eye import draw_birds_eye
from gazempc.results.figures.style import Logs
from gazempc.results.log import Log
from gazempc.results.metrics import gaze_error_deg


def draw_gaze_error(ax: Axes, logs: Logs) -> bool:
    """Draw the gaze error over time, the cone of eye contact and the part that is not scored.

    Args:
        ax: Axes to draw on.
        logs: The runs.

    Returns:
        Whether the error of the head alone is also drawn, as for a neck with eyes.
    """
    cone_deg = CONTACT_DEG[0]
    ax.axhspan(0.0, cone_deg, color=style.CONTACT_COLOUR, alpha=0.28, lw=0)
    ax.text(1.01, cone_deg, f"{cone_deg:g}°", transform=ax.get_yaxis_transform(), va="center", color="#00664B")
    top, end_s = 0.0, 0.0
    looks, heads_alone = style.styles(logs), False
    for name, log in logs.items():
        look, head = looks[name], known.shown_head(log)
        shown = head.log if head.rare else log
        error, alone = gaze_error_deg(shown), known.head_alone(shown)
        time_s = log.time_s - log.time_s[0]
        of_head = np.empty(0) if alone is None else gaze_error_deg(alone)
        if np.isfinite(of_head).any():
            ax.plot(time_s, of_head, color=look.colour, lw=1.1, ls=known.HEAD_LINE)
            top, heads_alone = max(top, float(np.nanmax(of_head))), True
        if np.isfinite(error).any():
            known.draw_known(ax, time_s, error, head, color=look.colour, lw=look.width)
        top, end_s = max(top, float(np.nanmax(error, initial=0.0))), max(end_s, float(time_s[-1]))
    if not top:
        unknown = not any(np.isfinite(log.head_true_base_m).any() for log in logs.values())
        style.note(ax, f"no gaze error: {'the true head is unknown' if unknown else 'the joints were not read'}")
    style.shade_unscored(ax, end_s, people.away_in_all(logs))
    ax.set(xlim=(0.0, end_s), ylim=(0.0, max(1.05 * top, 8.0)), xlabel="time (s)", ylabel="gaze error (deg)")
    return heads_alone


_ATTENDED_WIDTH = 8.0
# Number of letters that fit in the time line, and heights of a run's bars: attended person above, contact below.
_ATTENDED_LETTERS = 75
_WHO, _CONTACT = 0.5, 0.18


def attended(logs: Logs, path: Path) -> None:
    """Draw one time line per run.

    Args:
        logs: The runs.
        path: Picture to write.
    """
    with style.readable(_ATTENDED_WIDTH):
        figure = Figure(figsize=(_ATTENDED_WIDTH, 1.6 + 0.8 * len(logs)), dpi=style.DPI, layout="constrained")
        ax = figure.subplots()
        looks, end_s = style.styles(logs), 0.0
        for row, (_, log) in enumerate(logs.items()):
            people.draw_turns(ax, log, -float(row), _WHO, _ATTENDED_LETTERS)
            spans_s = people.spans(gaze_error_deg(log) <= CONTACT_DEG[0], log.time_s)
            bars = [(from_s, to_s - from_s) for from_s, to_s in spans_s]
            ax.broken_barh(bars, (-row - 0.5 * _WHO - _CONTACT, _CONTACT), color=style.CONTACT_COLOUR, lw=0)
            end_s = max(end_s, float(log.time_s[-1] - log.time_s[0]))
        ax.set_yticks([-float(row) for row in range(len(logs))], [looks[name].label for name in logs])
        ax.set(xlim=(0.0, end_s), ylim=(0.45 - len(logs), 0.4), xlabel="time (s)")
        numbers = sorted({turn.number for log in logs.values() for turn in people.turns(log)} - {0})
        legend = [Patch(color=people.person_colour(number), label=f"person {number}") for number in numbers]
        legend.append(Patch(facecolor="w", edgecolor="k", hatch="////", label="looks away"))
        if any(np.isfinite(gaze_error_deg(log)).any() for log in logs.values()):
            legend.append(Patch(color=style.CONTACT_COLOUR, label=f"contact (within {CONTACT_DEG[0]:g} deg)"))
        figure.legend(handles=legend, loc="outside lower center", ncols=4, frameon=False)
        known.finish(figure, logs, path)


_OVERVIEW_WIDTH = 32 / 3
# Above this share the label does not fit beside its bar.
_LONG_BAR = 0.75
_OF_ROBOT = "robot's"
# Number of letters that fit in the time line of the attended person.
_LETTERS = 52
_LONGEST_TITLE = 100


def draw_contact_bars(ax: Axes, logs: Logs) -> None:
    """Draw the share of the scored window with eye contact, a bar for each controller.

    For a neck with eyes, a second bar shows the share of the head alone.

    Args:
        ax: Axes to draw on.
        logs: The runs.
    """
    looks = style.styles(logs)
    for row, (name, log) in enumerate(logs.items()):
        alone, colour, share = known.head_alone(log), looks[name].colour, known.running_contact(log)[-1]
        # Below the gaze, the head alone: the share with centred eyes.
        height, at = (0.72, float(row)) if alone is None else (0.44, row - 0.14)
        _bar(ax, at, height, share, {"color": colour}, {"fontsize": "large", "fontweight": "bold"})
        if alone is not None:
            hatched = {"facecolor": "none", "edgecolor": colour, "hatch": "////"}
            share = known.running_contact(alone)[-1]
            text = _bar(ax, row + 0.24, 0.24, share, hatched, {"fontsize": "small"})
            text.set_text(f"{text.get_text()}, the head alone")
            if share > _LONG_BAR:
                # The label does not fit beside the bar.
                text.set(x=98.0 * share, ha="right", bbox={"fc": "w", "ec": "none", "pad": 0.5})
    ax.set_yticks(range(len(logs)), [look.label.replace(" with ", "\nwith ") for look in looks.values()])
    ax.set_ylim(len(logs) - 0.4, -0.6)
    # Margin for the label beside a full bar.
    ax.set(xlim=(0, 118), xticks=[0, 25, 50, 75, 100], xlabel="time with eye contact (% of the scored window)")
    ax.spines[["top", "right"]].set_visible(False)


def overview(logs: Logs, path: Path) -> None:
    """Draw the walk from above, the gaze error over time and the eye contact of each controller.

    Args:
        logs: The runs: controller name -> log of the same recording.
        path: Picture to write, 1600 x 900 pixels.
    """
    # A small size at high resolution: legible letters at half size.
    with style.readable(_OVERVIEW_WIDTH):
        figure = Figure(figsize=(_OVERVIEW_WIDTH, 6.0), dpi=style.DPI, layout="constrained")
        rows, heights = ["error", "bars"], [1.0, 0.25 + 0.13 * len(logs)]
        lines = _time_lines(logs) if people.has_attention(logs) else {}
        if lines:
            rows, heights = ["people", *rows], [0.06 + 0.09 * len(lines), *heights]
        # The right half shows the names of the controllers.
        halves = figure.add_gridspec(1, 2, width_ratios=[1.0, 1.3])
        column = halves[1].subgridspec(len(rows), 1, height_ratios=heights)
        axes = {row: figure.add_subplot(column[k]) for k, row in enumerate(rows)}
        axes["walk"] = figure.add_subplot(halves[0])
        beside = draw_birds_eye(axes["walk"], logs)
        lines_of = "".join(f"; {part.line_name}: {part.label.replace(_OF_ROBOT, 'its')}" for part in beside)
        axes["walk"].set_title(f"the walk from above, and where the robot looks{lines_of}", fontsize="medium")
        heads_alone = draw_gaze_error(axes["error"], logs)
        legend = "dashed: the head alone" if heads_alone else "grey: not scored"
        axes["error"].set_title(f"green: eye contact (within {CONTACT_DEG[0]:g}°); {legend}", fontsize="medium")
        if lines:
            _draw_people(axes["people"], lines, axes["error"].get_xlim())
        draw_contact_bars(axes["bars"], logs)
        about = style.recording_title(logs), style.setup_title(logs)
        joint = "; " if sum(map(len, about)) < _LONGEST_TITLE else "\n"
        titles = filter(None, (people.question(logs), joint.join(about), known.known_title(logs)))
        figure.suptitle("\n".join(titles))
        with naming(path):
            figure.savefig(path, dpi=style.DPI)


def _time_lines(logs: Logs) -> dict[str, Log]:
    """Time lines to draw: a single one if all runs are equal."""
    if people.are_alike(logs):
        return {"": next(iter(logs.values()))}
    return {look.label.split(" with ")[0]: logs[name] for name, look in style.styles(logs).items()}


def _draw_people(ax: Axes, lines: dict[str, Log], shown_s: tuple[float, float]) -> None:
    for row, log in enumerate(lines.values()):
        people.draw_turns(ax, log, float(row), 0.9, _LETTERS)
    ax.set_title("attended person; hatched: looks away", fontsize="medium")
    ax.set_yticks(range(len(lines)), list(lines) if len(lines) > 1 else [""] * len(lines))
    ax.tick_params(left=False)
    ax.set(xticks=[], xlim=shown_s, ylim=(len(lines) - 0.5, -0.5))
    ax.spines[:].set_visible(False)


def _bar(ax: Axes, at: float, height: float, share: float, look: dict[str, Any], font: dict[str, Any]) -> Text:
    percent = 100.0 * share
    ax.barh(at, percent, height=height, **look)
    text = f"{percent:.0f} %" if np.isfinite(percent) else "not known"
    return ax.text(np.nan_to_num(percent) + 1.5, at, text, va="center", **font)
