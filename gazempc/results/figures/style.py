"""The look that all figures share: colours, titles, what is not scored.

All figures take ``logs``: controller name -> log of the same recording, in the order in which they are shown.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass

from matplotlib.axes import Axes

from gazempc.results.log import Log
from gazempc.results.metrics import SCORED_FROM_S
from gazempc.results.report import LABELS

Logs = Mapping[str, Log]

CONTACT_COLOUR = "#009E73"
DPI = 150
_UNSCORED = "0.92"
# For controllers of the user's own; colour-blind people tell them apart (Paul Tol's muted scheme).
_OWN_COLOURS = ("#332288", "#999933", "#882255", "#44AA99", "#117733")


@dataclass(frozen=True)
class Style:
    """How a controller looks in every figure.

    Attributes:
        label: Name for people.
        colour: Colour that colour-blind people can tell apart too (Okabe and Ito).
        width: Line width, points; thinner lines are drawn over wider ones, so that both show where they meet.
    """

    label: str
    colour: str
    width: float


_STYLES = {
    "reactive": Style(LABELS["reactive"], "#D55E00", 2.0),
    "lookahead": Style(LABELS["lookahead"], "#56B4E9", 2.8),
    "mpc": Style(LABELS["mpc"], "#0072B2", 1.6),
    "perfect": Style(LABELS["perfect"], "#CC79A7", 1.6),
}


def style(controller: str) -> Style:
    """Look of a controller; one of the user's own keeps its name, and its name chooses its colour."""
    own = _OWN_COLOURS[zlib.crc32(controller.encode()) % len(_OWN_COLOURS)]
    return _STYLES.get(controller, Style(controller, own, 1.6))


def recording_title(logs: Logs) -> str:
    """Name and origin of the recording, such as ``subject03_R4 (turn), synthetic data``."""
    run = next(iter(logs.values())).run
    group = f" ({run.group})" if run.group else ""
    data = " data" if run.kind == "synthetic" else ""
    return f"{run.recording}{group}, {run.kind}{data}"


def setup_title(logs: Logs) -> str:
    """Predictor, neck, sensor and seed of the runs; the perfect forecast is named by its controller's label."""
    runs = [log.run for log in logs.values()]
    predictors = dict.fromkeys(run.predictor for run in runs if run.controller != "perfect")
    neck, sensor, seed = runs[0].neck.name, runs[0].sensor["name"], runs[0].seed
    return f"predictor {', '.join(predictors) or 'perfect'}; neck {neck}; sensor {sensor}; seed {seed}"


def shade_unscored(ax: Axes, end_s: float) -> None:
    """Shade the part of a time axis that is not scored; `end_s` is its end, seconds."""
    ax.axvspan(0.0, min(SCORED_FROM_S, end_s), color=_UNSCORED, lw=0, zorder=0.5, label="not scored")
