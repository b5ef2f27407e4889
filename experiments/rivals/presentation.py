"""Tables and pictures of a comparison with rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter

from experiments.engine.job import Row
from experiments.rivals.jobs import NAMES, OURS
from experiments.rivals.plan import ALL_STILL, ALL_WALKS, BEHIND
from experiments.rivals.trials import LOSS, POSTURES
from gazempc.results.figures.style import DPI, readable, style
from gazempc.results.page.content import PageTable

# Heading, figure, factor, digits.
_Column = tuple[str, str, float, int]
_ANSWERS: tuple[_Column, ...] = (
    ("overshoot (deg)", "overshoot_deg", 1.0, 2),
    ("settling to 1 deg (s)", "settling_s", 1.0, 2),
    ("to 2.6 deg (s)", "settling_2p6_s", 1.0, 2),
    ("reversals", "reversals", 1.0, 1),
    ("rests off the face by (deg)", "rest_error_deg", 1.0, 2),
)
_GAZES: tuple[_Column, ...] = (
    ("contact (%)", "eye_contact_2p6", 100.0, 1),
    ("RMS error (deg)", "gaze_error_rms_deg", 1.0, 2),
    ("RMS acceleration (rad/s2)", "rms_acceleration_rad_s2", 1.0, 2),
)
_BEHIND_MPC: _Column = ("behind the MPC (points)", BEHIND, 100.0, 1)
_COLUMNS: dict[str, tuple[_Column, ...]] = {
    ALL_STILL: (*_ANSWERS, *_GAZES[:1]),
    "step": _ANSWERS,
    "ramp": (*_ANSWERS, *_GAZES),
    **dict.fromkeys((*POSTURES, ALL_WALKS), (*_GAZES[:1], _BEHIND_MPC, *_GAZES[1:])),
    LOSS: (("back in contact after (s)", "recontact_s", 1.0, 2), *_GAZES),
}


def page_tables(rows: Sequence[Row]) -> list[PageTable]:
    """All tables, the best first.

    Args:
        rows: Rows as of `experiments.rivals.plan.summarise`.

    Returns:
        One for each trial, neck and sensor; the first cell of a row is the rival.
    """
    found = []
    for trial, columns in _COLUMNS.items():
        of_trial = [row for row in rows if row["trial"] == trial]
        for neck, sensor in dict.fromkeys((row["neck"], row["sensor"]) for row in of_trial):
            here = [row for row in of_trial if (row["neck"], row["sensor"]) == (neck, sensor)]
            cells = tuple((row["rival"], *(_cell(row, column) for column in columns)) for row in here)
            headings = ("", *(heading for heading, *_ in columns))
            found.append(PageTable(f"{trial}, neck {neck}, sensor {sensor}", headings, cells))
    return found


def _cell(row: Row, column: _Column) -> str:
    _, figure, factor, digits = column
    if row[figure] is None:
        return "–"
    mean = f"{factor * row[figure]:.{digits}f}"
    interval = row[f"{figure}_ci95"]
    if interval is None:
        return mean
    return f"{mean} ({factor * interval[0]:.{digits}f} to {factor * interval[1]:.{digits}f})"


# Colours that colour-blind people tell apart (Paul Tol's muted scheme); with the markers more rivals than there are.
_COLOURS = ("#332288", "#999933", "#882255", "#44AA99", "#117733", "#AA4499", "#DDCC77")
_MARKERS = "sD^v<>PX"
_TICKS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)


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


def _points(ax: Axes, rows: Sequence[Row]) -> None:
    for row in rows:
        rival, ours = row["rival"], row["rival"] in OURS
        k = NAMES.index(rival)
        colour = style(rival).colour if ours else _COLOURS[k % len(_COLOURS)]
        x, y = row["rms_acceleration_rad_s2"], 100.0 * row["eye_contact_2p6"]
        if interval := row["eye_contact_2p6_ci95"]:
            ax.plot([x, x], [100.0 * end for end in interval], color=colour, lw=1.0)
        marker, size = ("o", 9) if ours else (_MARKERS[k % len(_MARKERS)], 6)
        ax.plot([x], [y], marker, color=colour, ms=size, label=f"ours: {rival}" if ours else rival)


def error_tables(by_label: Mapping[str, Sequence[Row]], level: Sequence[Row]) -> list[PageTable]:
    """Eye contact with wrong models.

    Args:
        by_label: Rows with ``rival``, ``by`` and ``eye_contact_2p6``, by the label of the error.
        level: Rows of rivals without a model.

    Returns:
        A table for each error, and one of the laws without a model.
    """
    tables = []
    for label, of_error in by_label.items():
        ticks = sorted({row["by"] for row in of_error})
        lines = []
        for rival in dict.fromkeys(row["rival"] for row in of_error):
            percent = {row["by"]: 100.0 * row["eye_contact_2p6"] for row in of_error if row["rival"] == rival}
            lines.append((rival, *(f"{percent[by]:.1f}" if by in percent else "-" for by in ticks)))
        tables.append(PageTable(f"Eye contact in %, by {label}", ("", *(f"{by:+g}" for by in ticks)), tuple(lines)))
    without = tuple((row["rival"], f"{100.0 * row['eye_contact_2p6']:.1f}") for row in level)
    return [*tables, PageTable("Eye contact in % of laws without a model", ("", "all errors"), without)]
