"""The report of a comparison with rivals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.engine.job import Row
from experiments.page_parts import shares
from experiments.rivals.figures import colour_of
from experiments.rivals.jobs import OURS
from experiments.rivals.plan import ALL_WALKS
from experiments.rivals.report import page_tables
from experiments.rivals.trials import WALKS
from gazempc.results.page.chart import Chart, Curve
from gazempc.results.page.content import Page, PageTable, Unusual

# So many laws, and ours, are named in the answer.
_BEST = 3


@dataclass(frozen=True)
class RivalsPage:
    """What a comparison shows.

    Attributes:
        rows: What stands in the file of rows.
        answer: What came out, in sentences.
        tables: The numbers.
        charts: Curves.
        pictures: Figures.
    """

    rows: list[Row]
    answer: tuple[str, ...]
    tables: tuple[PageTable, ...]
    charts: tuple[Chart, ...]
    pictures: tuple[Path, ...]


def shown_gazes(rows: list[Row], runs: Sequence[Row], pictures: Iterable[Path]) -> RivalsPage:
    """What a comparison with the right model shows.

    Args:
        rows: As of `experiments.rivals.plan.summarise`.
        runs: The runs behind them.
        pictures: Figures.
    """
    return RivalsPage(rows, tuple(_answers(rows)), tuple(page_tables(rows)), tuple(_charts(runs)), tuple(pictures))


def shown_errors(rows: list[Row], by_label: Mapping[str, Sequence[Row]], pictures: Iterable[Path]) -> RivalsPage:
    """What wrong models show.

    Args:
        rows: All rows.
        by_label: Rows with ``rival``, ``by`` and ``eye_contact_2p6``, by the label of the error.
        pictures: Figures.
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
    answer = "How much eye contact is lost by what is believed wrongly stands in the tables; 0 is the right model."
    return RivalsPage(rows, (answer,), tuple(tables), tuple(charts), tuple(pictures))


def rivals_page(
    shown: RivalsPage, settings: Mapping[str, Any], failed: Sequence[Row], left_out: int, command: str
) -> Page:
    """The report.

    Args:
        shown: What came out.
        settings: All settings.
        failed: Runs that failed.
        left_out: How many runs were left out.
        command: What repeats it.

    Returns:
        The report.
    """
    unusual = [
        Unusual(f"failed: {run['rival']}, {run['trial']}, {run['recording']}, {run['neck']}", run["failed"])
        for run in failed
    ]
    if left_out:
        unusual.append(Unusual(f"{left_out} runs left out", "The walk is too near, or too short."))
    return Page(
        title="Comparison with control laws that others run",
        question="In the same trials, with the same camera and necks: who keeps eye contact, and how smoothly?",
        answer=shown.answer,
        setup={
            "walks": ", ".join(settings["recordings"]) or "21 synthetic ones",
            "laws": ", ".join(settings["rivals"]),
            "necks": ", ".join(settings["necks"]),
            "sensors": ", ".join(settings["sensors"]),
            "seed": str(settings["seed"]),
            "ours": ", ".join(OURS),
            "numbers": "means over clips, in brackets 95 % bootstrap intervals over people; the best first",
        },
        tables=shown.tables,
        charts=shown.charts,
        pictures={path: path.stem.replace("_", " ") for path in shown.pictures},
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
