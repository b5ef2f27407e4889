"""The report of the least gaze error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from experiments.engine.job import Row
from experiments.page_parts import failures, left_out, shares
from gazempc.results.figures.style import COLOURS, styles
from gazempc.results.page.content import Page, PageTable
from gazempc.results.run_summary import label


def bound_page(
    rows: Sequence[Row], columns: Sequence[str], table: PageTable, settings: Mapping[str, Any], command: str
) -> Page:
    """The report of a comparison with the bound.

    Args:
        rows: One for each recording, see `experiments.bound.bound`.
        columns: The gazes, and the bound last.
        table: Means over clips, all of them in the last row.
        settings: All settings.
        command: What repeats it.

    Returns:
        The report.
    """
    done = [row for row in rows if not row["left_out"] and not row["failed"]]
    looks = styles(columns[:-1])
    names = {name: (label(name), looks[name].colour) for name in columns[:-1]}
    names[columns[-1]] = ("least possible", COLOURS[-1])
    clips = {look: {row["recording"]: row[name] for row in done} for name, look in names.items()}
    means = dict(zip(table.columns, table.rows[-1], strict=True)) if table.rows else {}
    said = ", ".join(f"{name} {means[name]}" for name, _ in names.values() if means)
    return Page(
        title="Least gaze error",
        question="How much of the gaze error is due to the neck's limits, and no controller can avoid it?",
        answer=(f"Mean RMS gaze error in degrees: {said}.",) if said else (),
        setup={
            "neck": str(settings["neck"]),
            "sensor": str(settings["sensor"] or "the one that fits each recording"),
            "robot": f"{settings['distance_m']:g} m beside the walk",
            "recordings": ", ".join(settings["recordings"]),
            "seed": str(settings["seed"]),
        },
        tables=(table,),
        charts=(shares("Clips by gaze error", "RMS gaze error of a clip (deg)", clips),),
        unusual=(
            *failures(row for row in rows if row["failed"]),
            *left_out({row["recording"]: row["left_out"] for row in rows if row["left_out"]}),
        ),
        command=command,
        settings=settings,
    )
