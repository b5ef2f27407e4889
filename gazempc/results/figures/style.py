"""Common style of all figures: colours, line styles, font sizes, titles, shading of unscored time.

All figures take ``logs``: controller name -> log of the same recording, in order of display.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gazempc.parts import TRUE_FUTURE
from gazempc.recordings.load import MARK
from gazempc.results.log import Log
from gazempc.results.metrics import SCORED_FROM_S
from gazempc.results.run_summary import LABELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Logs = Mapping[str, Log]

# Okabe and Ito's colours, for colour-blind people, too.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
CONTACT_COLOUR = "#009E73"
# Observations are points, because the path between them was not observed.
OBSERVED: dict[str, Any] = {"color": "k", "ls": "", "marker": ".", "ms": 3.0, "mew": 0.0, "alpha": 0.55}
DPI = 150
_UNSCORED = "0.92"
# For user-defined controllers (Paul Tol's muted scheme, for colour-blind people, too).
_OWN_COLOURS = ("#332288", "#999933", "#882255", "#44AA99", "#117733")
# Font size per inch of a figure's width, points: at the width of a README, some 830 pixels, medium letters are then 11
# pixels high.
_POINTS_PER_INCH = 0.96
_LEAST_POINTS = 10.0
# Maximum length of the joined names of simultaneous recordings, so that the title fits.
_LONGEST_NAME = 48


@dataclass(frozen=True)
class Style:
    """Style of a controller in all figures.

    Attributes:
        label: Display name.
        colour: Colour for colour-blind people, too (Okabe and Ito).
        width: Line width, points; thinner lines are drawn over wider ones, so that both show where they meet.
    """

    label: str
    colour: str
    width: float


_STYLES = {
    "reactive": Style(LABELS["reactive"], "#D55E00", 2.0),
    "lookahead": Style(LABELS["lookahead"], "#56B4E9", 2.8),
    "mpc": Style(LABELS["mpc"], "#0072B2", 1.6),
    TRUE_FUTURE: Style(LABELS[TRUE_FUTURE], "#CC79A7", 1.6),
}


def styles(controllers: Iterable[str]) -> dict[str, Style]:
    """Styles of the controllers of one figure.

    Args:
        controllers: Their names.

    Returns:
        Name -> style. User-defined controllers get different colours, as far as available.
    """
    found: dict[str, Style] = {}
    for name in controllers:
        taken = {each.colour for each in found.values()}
        start = zlib.crc32(name.encode())
        order = [_OWN_COLOURS[(start + k) % len(_OWN_COLOURS)] for k in range(len(_OWN_COLOURS))]
        own = next((colour for colour in order if colour not in taken), order[0])
        found[name] = _STYLES.get(name) or Style(name, own, 1.6)
    return found


@contextmanager
def readable(width_inches: float) -> Iterator[None]:
    """Font sizes that make a figure of this width legible in a README.

    Args:
        width_inches: Width of the figure, inches.
    """
    # Reports need the colours only, and matplotlib takes a second to import.
    import matplotlib as mpl  # noqa: PLC0415

    with mpl.rc_context({"font.size": max(_LEAST_POINTS, _POINTS_PER_INCH * width_inches)}):
        yield


def recording_title(logs: Logs) -> str:
    """Name and origin of the recording, such as ``subject03_R4 (turn), synthetic data``; of many the first one."""
    run = next(iter(logs.values())).run
    name, *others = run.recording.split(MARK)
    if len(run.recording) <= _LONGEST_NAME:
        name, others = run.recording, []
    name += f" and {len(others)} more" if others else ""
    group = f" ({run.group})" if run.group else ""
    data = " data" if run.kind == "synthetic" else ""
    return f"{name}{group}, {run.kind}{data}"


def setup_title(logs: Logs) -> str:
    """Predictor, neck, sensor and seed of the runs; the perfect forecast is named by its controller's label."""
    runs = [log.run for log in logs.values()]
    predictors = dict.fromkeys(run.predictor for run in runs if run.controller != TRUE_FUTURE)
    neck, sensor, seed = runs[0].neck.name, runs[0].sensor["name"], runs[0].seed
    return f"predictor {', '.join(predictors) or 'perfect'}; neck {neck}; sensor {sensor}; seed {seed}"


def shade_unscored(ax: Axes, end_s: float, away_s: Iterable[tuple[float, float]] = ()) -> None:
    """Shade the unscored intervals of a time axis.

    Args:
        ax: Axes to draw on.
        end_s: Its end, seconds.
        away_s: Beginnings and ends of looks away, seconds.
    """
    ax.axvspan(0.0, min(SCORED_FROM_S, end_s), color=_UNSCORED, lw=0, zorder=0.5, label="not scored")
    for from_s, to_s in away_s:
        ax.axvspan(from_s, to_s, color=_UNSCORED, lw=0, zorder=0.5)


def note(ax: Axes, why: str, height: float = 0.5) -> None:
    """Note why data are missing from a figure; `height` is a share of the axes."""
    box = {"fc": "w", "ec": "none", "alpha": 0.85, "pad": 2.0}
    ax.text(0.5, height, why, transform=ax.transAxes, ha="center", va="center", bbox=box, zorder=10)
