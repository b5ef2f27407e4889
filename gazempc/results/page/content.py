"""Content of a report, independent of HTML: tables, decimated curves, pictures, events."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.types import FloatArray

# Maximum number of points: twice the columns of a wide screen.
_POINTS = 4000
# Dash patterns, distinguishable in print without colours: dashes and gaps, pixels.
_DASHES = ("", "8 5", "2 4", "12 5 2 5", "5 8", "16 6", "8 4 2 4 2 4", "1 8")


@dataclass(frozen=True)
class Curve:
    """One curve.

    Attributes:
        label: Its name in the legend.
        colour: CSS colour.
        x: Rising, shape (N,).
        y: Shape (N,); NaN leaves a gap.
        names: Name of each point, shape (N,); empty where the axes suffice.
    """

    label: str
    colour: str
    x: FloatArray
    y: FloatArray
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Span:
    """Interval of the axis.

    Attributes:
        start: Lower end.
        end: Upper end.
        name: Its name.
        colour: CSS colour of a bar along the top; empty for a grey ground.
    """

    start: float
    end: float
    name: str
    colour: str = ""


@dataclass(frozen=True)
class Chart:
    """Curves over one axis.

    Attributes:
        title: Title.
        x_label: Name and unit.
        y_label: Name and unit.
        curves: The curves; the first ones are drawn below the others.
        levels: Heights of horizontal lines, with their names.
        spans: Marked intervals of the axis.
    """

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    levels: tuple[tuple[float, str], ...] = ()
    spans: tuple[Span, ...] = ()

    def dash(self, index: int) -> str:
        """Dash pattern of a curve, in SVG format."""
        return _DASHES[index % len(_DASHES)]

    def as_dict(self) -> dict[str, Any]:
        """Data of the page's script; NaN is None."""
        return {
            "x": self.x_label,
            "y": self.y_label,
            "levels": self.levels,
            "spans": [vars(span) for span in self.spans],
            "curves": [
                {"label": c.label, "dash": self.dash(i), "xs": _numbers(c.x[keep]), "ys": _numbers(c.y[keep])}
                | ({"names": c.names} if c.names else {})
                for i, (c, keep) in enumerate((c, _kept(c)) for c in self.curves)
            ],
        }


def _kept(curve: Curve) -> list[int]:
    """Indices of the points to keep: those with names, or minimum and maximum of each interval: no peak is lost."""
    y = curve.y
    if curve.names or y.size <= _POINTS:
        return list(range(y.size))
    kept: list[int] = []
    for part in np.array_split(np.arange(y.size), _POINTS // 2):
        known = part[np.isfinite(y[part])]
        kept += sorted({known[np.argmin(y[known])], known[np.argmax(y[known])]}) if known.size else part[:1].tolist()
    return kept


def _numbers(values: FloatArray) -> list[float | None]:
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values]


# A number with an optional sign, or the dash for an unknown value.
_NUMBER = re.compile(r"[-+−–]?\d|[-–]$")


@dataclass(frozen=True)
class PageTable:
    """A table of texts.

    Attributes:
        title: Title; may be empty.
        columns: Heading of each column.
        rows: Cells, one tuple a row. A label with a leading space continues the row above.
        note: Text below the table.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Whether each column is numeric: most of its cells are numbers."""
        columns = zip(*self.rows, strict=True) if self.rows else ((),) * len(self.columns)
        return tuple(2 * sum(bool(_NUMBER.match(cell)) for cell in cells) > len(cells) for cells in columns)

    def markdown(self) -> list[str]:
        """The table as lines of Markdown, without title and note."""
        lines = [f"| {' | '.join(self.columns)} |", "|" + "---|" * len(self.columns)]
        return lines + [f"| {' | '.join(cells)} |" for cells in self.rows]


@dataclass(frozen=True)
class Unusual:
    """An unusual event.

    Attributes:
        what: Short description, with numbers.
        text: Its meaning.
        traceback: Traceback of the first exception, if any.
    """

    what: str
    text: str = ""
    traceback: str = ""


@dataclass(frozen=True)
class Page:
    """A report.

    Attributes:
        title: Title.
        question: Question that the report answers.
        answer: The conclusion, in sentences.
        setup: Set-up: name -> description.
        tables: The numbers.
        charts: Zoomable curves.
        pictures: Files to embed, with captions.
        unusual: Unusual events.
        command: Command line that reproduces the run.
        settings: All settings, defaults included.
    """

    title: str
    question: str
    answer: tuple[str, ...]
    setup: Mapping[str, str]
    command: str
    settings: Mapping[str, Any]
    tables: tuple[PageTable, ...] = ()
    charts: tuple[Chart, ...] = ()
    pictures: Mapping[Path, str] = field(default_factory=dict)
    unusual: tuple[Unusual, ...] = ()
