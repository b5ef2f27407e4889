"""One picture that tells a run to a stranger."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gazempc.results.contact import CONTACT_DEG
from gazempc.results.figures.birds_eye import draw_birds_eye
from gazempc.results.figures.gaze_error import draw_gaze_error
from gazempc.results.figures.known import known_title
from gazempc.results.figures.style import Logs, recording_title, setup_title, style
from gazempc.results.metrics import measure


def draw_contact_bars(ax: Axes, logs: Logs) -> None:
    """Draw the share of the scored window with eye contact, a bar for each controller.

    Args:
        ax: Axes to draw on.
        logs: The runs.
    """
    for row, (name, log) in enumerate(logs.items()):
        look, percent = style(name), 100.0 * measure(log).eye_contact_2p6
        ax.barh(row, percent, color=look.colour, height=0.72)
        said = f"{percent:.0f} %" if np.isfinite(percent) else "not known"
        ax.text(np.nan_to_num(percent) + 1.5, row, said, va="center", fontsize="large", fontweight="bold")
    ax.set_yticks(range(len(logs)), [style(name).label.replace(" with ", "\nwith ") for name in logs])
    ax.set_ylim(len(logs) - 0.4, -0.6)
    # Room for the figure beside a full bar.
    ax.set(xlim=(0, 116), xticks=[0, 25, 50, 75, 100], xlabel="time with eye contact (% of the scored window)")
    ax.spines[["top", "right"]].set_visible(False)


def overview(logs: Logs, path: Path) -> None:
    """Draw the walk from above, the gaze error over time and the eye contact of each controller.

    Args:
        logs: The runs: controller name -> log of the same recording.
        path: Picture to write, 1600 x 900 pixels.
    """
    # Few inches and many dots make letters that still read at half size.
    figure = Figure(figsize=(32 / 3, 6.0), dpi=150, layout="constrained")
    axes = figure.subplot_mosaic(
        [["walk", "error"], ["walk", "bars"]],
        width_ratios=[1.0, 1.0],
        height_ratios=[1.0, 0.25 + 0.13 * len(logs)],
    )
    draw_birds_eye(axes["walk"], logs)
    axes["walk"].set_title("the walk from above, and where the robot looks")
    draw_gaze_error(axes["error"], logs, detailed=False)
    axes["error"].set_title(f"green: eye contact (within {CONTACT_DEG[0]:g}°); grey: not scored")
    draw_contact_bars(axes["bars"], logs)
    about = f"{recording_title(logs)}; {setup_title(logs)}"
    lines = filter(None, ("Does the robot keep eye contact with a walking person?", about, known_title(logs)))
    figure.suptitle("\n".join(lines))
    figure.savefig(path, dpi=150)
