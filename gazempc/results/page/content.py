"""What a report holds, before it is HTML."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gazempc.results.page.chart import Chart

# A number, perhaps with a sign, or the dash of one that is not known.
_NUMBER = re.compile(r"[-+−–]?\d|[-–]$")


@dataclass(frozen=True)
class PageTable:
    """A table of texts.

    Attributes:
        title: What stands above it; may be empty.
        columns: Heading of each column.
        rows: Cells, one tuple a row. A first cell that begins with a space goes on with the row above it.
        note: What a reader must know of it; stands below.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Which columns hold numbers: most of their cells are some."""
        columns = zip(*self.rows, strict=True) if self.rows else ((),) * len(self.columns)
        return tuple(2 * sum(bool(_NUMBER.match(cell)) for cell in cells) > len(cells) for cells in columns)

    def markdown(self) -> list[str]:
        """The table as lines of Markdown, without title and note."""
        lines = [f"| {' | '.join(self.columns)} |", "|" + "---|" * len(self.columns)]
        return lines + [f"| {' | '.join(cells)} |" for cells in self.rows]


@dataclass(frozen=True)
class Unusual:
    """Something out of the ordinary.

    Attributes:
        what: In a few words, with numbers.
        text: What it means.
        traceback: Of the first exception, if there was one.
    """

    what: str
    text: str = ""
    traceback: str = ""


@dataclass(frozen=True)
class Page:
    """A report.

    Attributes:
        title: What was done.
        question: What it is to answer.
        answer: The sentences that say what came out.
        setup: What it was made with: name -> words.
        tables: The numbers.
        charts: Curves that can be zoomed.
        pictures: Files to embed, with what each shows.
        unusual: What was out of the ordinary.
        command: What repeats it.
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
