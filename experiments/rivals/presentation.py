"""Tables, pictures and the report of a comparison with rivals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter

from experiments.engine.job import Row
from experiments.pages import shares
from experiments.rivals.jobs import NAMES, OURS
from experiments.rivals.plan import ALL_STILL, ALL_WALKS, BEHIND
from experiments.rivals.trials import LOSS, POSTURES, WALKS
from gazempc.results.figures.style import DPI, readable, style
from gazempc.results.page.content import Chart, Curve, Page, PageTable, Unusual

# Heading, figure, factor, digits.
_Column = tuple[str, str, float, int]
# Sentences, tables and charts of a report.
Shown = tuple[tuple[str, ...], tuple[PageTable, ...], tuple[Chart, ...]]
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
    told = f"{factor * row[figure]:.{digits}f}"
    interval = row[f"{figure}_ci95"]
    if interval is None:
        return told
    return f"{told} ({factor * interval[0]:.{digits}f} to {factor * interval[1]:.{digits}f})"


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


# So many laws, and ours, are named in the answer.
_BEST = 3


def of_gazes(rows: Sequence[Row], runs: Sequence[Row]) -> Shown:
    """What a comparison with the right model shows.

    Args:
        rows: As of `experiments.rivals.plan.summarise`.
        runs: The runs behind them.

    Returns:
        Answer, tables and charts.
    """
    return tuple(_answers(rows)), tuple(page_tables(rows)), tuple(_charts(runs))


def of_errors(by_label: Mapping[str, Sequence[Row]], level: Sequence[Row]) -> Shown:
    """What wrong models show.

    Args:
        by_label: Rows with ``rival``, ``by`` and ``eye_contact_2p6``, by the label of the error.
        level: Rows of rivals without a model.

    Returns:
        Answer, tables and charts.
    """
    tables, charts = [], []
    for label, of_error in by_label.items():
        ticks = sorted({row["by"] for row in of_error})
        lines, curves = [], []
        for rival in dict.fromkeys(row["rival"] for row in of_error):
            percent = {row["by"]: 100.0 * row["eye_contact_2p6"] for row in of_error if row["rival"] == rival}
            lines.append((rival, *(f"{percent[by]:.1f}" if by in percent else "-" for by in ticks)))
            known = np.array([(by, percent[by]) for by in ticks if by in percent])
            curves.append(Curve(rival, colour_of(rival), known[:, 0], known[:, 1]))
        tables.append(PageTable(f"Eye contact in %, by {label}", ("", *(f"{by:+g}" for by in ticks)), tuple(lines)))
        charts.append(Chart(f"Eye contact over {label}", label, "eye contact (%)", tuple(curves)))
    lines = [(row["rival"], f"{100.0 * row['eye_contact_2p6']:.1f}") for row in level]
    tables.append(PageTable("Eye contact in % of laws without a model", ("", "all errors"), tuple(lines)))
    answer = "The tables show the eye contact that an error of the model costs; 0 is the right model."
    return (answer,), tuple(tables), tuple(charts)


def rivals_page(
    shown: Shown,
    pictures: Iterable[Path],
    settings: Mapping[str, Any],
    failed: Sequence[Row],
    left_out: int,
    command: str,
) -> Page:
    """The report of a comparison.

    Args:
        shown: Answer, tables and charts.
        pictures: Figures.
        settings: All settings.
        failed: Runs that failed.
        left_out: Number of runs that were left out.
        command: What repeats it.

    Returns:
        The report.
    """
    answer, tables, charts = shown
    unusual = [
        Unusual(f"failed: {run['rival']}, {run['trial']}, {run['recording']}, {run['neck']}", run["failed"])
        for run in failed
    ]
    if left_out:
        unusual.append(Unusual(f"{left_out} runs left out", "The walk is too near, or too short."))
    return Page(
        title="Comparison with control laws that others run",
        question="In the same trials, with the same camera and necks: who keeps eye contact, and how smoothly?",
        answer=answer,
        setup={
            "walks": ", ".join(settings["recordings"]) or "21 synthetic ones",
            "laws": ", ".join(settings["rivals"]),
            "necks": ", ".join(settings["necks"]),
            "sensors": ", ".join(settings["sensors"]),
            "seed": str(settings["seed"]),
            "ours": ", ".join(OURS),
            "numbers": "means over clips, in brackets 95 % bootstrap intervals over people; the best first",
        },
        tables=tables,
        charts=charts,
        pictures={path: path.stem.replace("_", " ") for path in pictures},
        unusual=tuple(unusual),
        command=command,
        settings=settings,
    )


def _answers(rows: Sequence[Row]) -> Iterator[str]:
    walks = [row for row in rows if row["trial"] == ALL_WALKS]
    for neck, sensor in dict.fromkeys((row["neck"], row["sensor"]) for row in walks):
        here = [row for row in walks if (row["neck"], row["sensor"]) == (neck, sensor)]
        told = [row for k, row in enumerate(here) if k < _BEST or row["rival"] in OURS]
        said = ", ".join(f"{row['rival']} {100.0 * row['eye_contact_2p6']:.1f} %" for row in told)
        yield f"Time with eye contact on walks, neck {neck}, sensor {sensor}: {said}. All {len(here)} are in the table."


def _charts(runs: Sequence[Row]) -> Iterator[Chart]:
    walks = [run for run in runs if run["trial"] in WALKS]
    for neck, sensor in dict.fromkeys((run["neck"], run["sensor"]) for run in walks):
        clips: dict[tuple[str, str], dict[str, float]] = {}
        for run in walks:
            if (run["neck"], run["sensor"]) == (neck, sensor):
                of_rival = clips.setdefault((run["rival"], colour_of(run["rival"])), {})
                of_rival[f"{run['recording']}, {run['trial']}"] = run["gaze_error_rms_deg"]
        yield shares(f"Walks by gaze error: neck {neck}, sensor {sensor}", "RMS gaze error of a walk (deg)", clips)
