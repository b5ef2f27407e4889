"""One picture that tells a run to a stranger."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.birds_eye import draw_birds_eye
from gazempc.results.figures.gaze_error import draw_gaze_error
from gazempc.results.figures.head_and_body import Part, head_alone
from gazempc.results.figures.known import contact_shares, known_title
from gazempc.results.figures.people import are_alike, draw_turns, has_attention, question
from gazempc.results.figures.style import DPI, Logs, readable, recording_title, setup_title, styles
from gazempc.results.log import Log

_WIDTH = 32 / 3
# Beside a bar of a larger share its words have no room.
_LONG_BAR = 0.75
_OF_ROBOT = "robot's"
# Letters that have room in the time line of whom the gaze was for.
_LETTERS = 52
_LONGEST_TITLE = 100


def draw_contact_bars(ax: Axes, logs: Logs) -> None:
    """Draw the share of the scored window with eye contact, a bar for each controller.

    Of a neck with eyes a second bar says what the head alone would have.

    Args:
        ax: Axes to draw on.
        logs: The runs.
    """
    looks = styles(logs)
    for row, (name, log) in enumerate(logs.items()):
        alone, colour = head_alone(log), looks[name].colour
        # Below the gaze of eyes and head together that of the head, if the eyes looked where it points.
        height, at = (0.72, float(row)) if alone is None else (0.44, row - 0.14)
        _bar(ax, at, height, contact_shares(log)[0], {"color": colour}, {"fontsize": "large", "fontweight": "bold"})
        if alone is not None:
            hatched = {"facecolor": "none", "edgecolor": colour, "hatch": "////"}
            text = _bar(ax, row + 0.24, 0.24, contact_shares(alone)[0], hatched, {"fontsize": "small"})
            text.set_text(f"{text.get_text()}, the head alone")
            if contact_shares(alone)[0] > _LONG_BAR:
                # Inside, as there is no room beside it.
                text.set(x=98.0 * contact_shares(alone)[0], ha="right", bbox={"fc": "w", "ec": "none", "pad": 0.5})
    ax.set_yticks(range(len(logs)), [look.label.replace(" with ", "\nwith ") for look in looks.values()])
    ax.set_ylim(len(logs) - 0.4, -0.6)
    # Room for the figure beside a full bar.
    ax.set(xlim=(0, 118), xticks=[0, 25, 50, 75, 100], xlabel="time with eye contact (% of the scored window)")
    ax.spines[["top", "right"]].set_visible(False)


def overview(logs: Logs, path: Path) -> None:
    """Draw the walk from above, the gaze error over time and the eye contact of each controller.

    Args:
        logs: The runs: controller name -> log of the same recording.
        path: Picture to write, 1600 x 900 pixels.
    """
    # Few inches and many dots make letters that still read at half size.
    with readable(_WIDTH):
        figure = Figure(figsize=(_WIDTH, 6.0), dpi=DPI, layout="constrained")
        rows, heights = ["error", "bars"], [1.0, 0.25 + 0.13 * len(logs)]
        people = _time_lines(logs) if has_attention(logs) else {}
        if people:
            rows, heights = ["people", *rows], [0.06 + 0.09 * len(people), *heights]
        # The right half has the names of the controllers.
        halves = figure.add_gridspec(1, 2, width_ratios=[1.0, 1.3])
        column = halves[1].subgridspec(len(rows), 1, height_ratios=heights)
        axes = {row: figure.add_subplot(column[k]) for k, row in enumerate(rows)}
        axes["walk"] = figure.add_subplot(halves[0])
        beside = draw_birds_eye(axes["walk"], logs, detailed=False)
        axes["walk"].set_title(_walk_title(beside), fontsize="medium")
        heads_alone = draw_gaze_error(axes["error"], logs, detailed=False)
        said = (
            "; dashed: error of the head alone" if heads_alone else f" (within {CONTACT_DEG[0]:g}°); grey: not scored"
        )
        axes["error"].set_title(f"green: eye contact{said}", fontsize="medium")
        if people:
            _draw_people(axes["people"], people, axes["error"].get_xlim())
        draw_contact_bars(axes["bars"], logs)
        about = f"{recording_title(logs)}; {setup_title(logs)}"
        if len(about) > _LONGEST_TITLE:
            about = f"{recording_title(logs)}\n{setup_title(logs)}"
        lines = filter(None, (question(logs), about, known_title(logs)))
        figure.suptitle("\n".join(lines))
        figure.savefig(path, dpi=DPI)


def _time_lines(logs: Logs) -> dict[str, Log]:
    """Whose time lines are drawn: one of all gazes where these are alike."""
    if are_alike(logs):
        return {"": next(iter(logs.values()))}
    return {look.label.split(" with ")[0]: logs[name] for name, look in styles(logs).items()}


def _draw_people(ax: Axes, people: dict[str, Log], shown_s: tuple[float, float]) -> None:
    for row, log in enumerate(people.values()):
        draw_turns(ax, log, float(row), 0.9, _LETTERS)
    ax.set_title("whom the gaze is for; hatched: it looks away", fontsize="medium")
    ax.set_yticks(range(len(people)), list(people) if len(people) > 1 else [""] * len(people))
    ax.tick_params(left=False)
    ax.set(xticks=[], xlim=shown_s, ylim=(len(people) - 0.5, -0.5))
    ax.spines[:].set_visible(False)


def _walk_title(beside: tuple[Part, ...]) -> str:
    if not beside:
        return "the walk from above, and where the robot looks"
    said = (f"{part.line_name}: {part.label.replace(_OF_ROBOT, 'its')}" for part in beside)
    return f"where the robot looks; {', '.join(said)}"


def _bar(ax: Axes, at: float, height: float, share: float, look: dict[str, Any], font: dict[str, Any]) -> Text:
    percent = 100.0 * share
    ax.barh(at, percent, height=height, **look)
    said = f"{percent:.0f} %" if np.isfinite(percent) else "not known"
    return ax.text(np.nan_to_num(percent) + 1.5, at, said, va="center", **font)
