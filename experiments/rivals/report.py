"""Tables of a comparison of rivals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from experiments.rivals.jobs import OURS
from experiments.rivals.plan import ALL_STILL, ALL_WALKS, BEHIND
from experiments.rivals.trials import LOSS
from gazempc.results.page.content import PageTable

Row = dict[str, Any]
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
_COLUMNS: dict[str, tuple[_Column, ...]] = {
    ALL_STILL: (*_ANSWERS, *_GAZES[:1]),
    "step": _ANSWERS,
    "ramp": (*_ANSWERS, *_GAZES),
    ALL_WALKS: (*_GAZES[:1], ("behind the MPC (points)", BEHIND, 100.0, 1), *_GAZES[1:]),
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


def tables(rows: Sequence[Row]) -> str:
    """All tables, in Markdown: the best first, ours in bold.

    Args:
        rows: Rows as of `experiments.rivals.plan.summarise`.

    Returns:
        The text.
    """
    lines: list[str] = []
    for table in page_tables(rows):
        cells = tuple((f"**{name}**" if name in OURS else name, *rest) for name, *rest in table.rows)
        lines += [f"## {table.title}", "", *replace(table, rows=cells).markdown(), ""]
    return "\n".join(lines)


def _cell(row: Row, column: _Column) -> str:
    _, figure, factor, digits = column
    if row[figure] is None:
        return "–"
    told = f"{factor * row[figure]:.{digits}f}"
    interval = row[f"{figure}_ci95"]
    if interval is None:
        return told
    return f"{told} ({factor * interval[0]:.{digits}f} to {factor * interval[1]:.{digits}f})"
