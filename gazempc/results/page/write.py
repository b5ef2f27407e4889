"""Writes a report as one self-contained HTML file."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined

from gazempc.files.whole import write_whole
from gazempc.results.page.content import Page, PageTable, Unusual
from gazempc.results.run_summary import versions

# Size limit of a page, text included: mail programs accept it.
MAX_PAGE_BYTES = 3_000_000


def embed(pictures: Mapping[Path, str], room_bytes: int) -> list[dict[str, str]]:
    """Read pictures in order, up to a size limit.

    Args:
        pictures: PNG and GIF files, with captions.
        room_bytes: Size limit of all encoded pictures, bytes.

    Returns:
        Values of the template, in the same order; without data beyond the limit.
    """
    found = []
    for path, about in pictures.items():
        encoded = base64.b64encode(path.read_bytes()).decode()
        uri = f"data:image/{path.suffix[1:]};base64,{encoded}" if len(encoded) <= room_bytes else ""
        room_bytes -= len(uri)
        found.append({"name": path.name, "about": about, "uri": uri})
    return found


NAME = "report.html"
# Limits of the page's length.
_MAX_ROWS, _MAX_UNUSUAL, _MAX_TEXT = 500, 100, 4000


def write_page(page: Page, out: Path) -> str:
    """Write a report.

    Args:
        page: The report.
        out: Folder to write it to.

    Returns:
        Name of the file.
    """
    environment = Environment(
        loader=PackageLoader("gazempc.results.page"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters["shorter"] = _shorter
    template = environment.get_template("report.html")
    more = len(page.unusual) - _MAX_UNUSUAL
    values = {
        "page": page,
        "tables": [_cut(table) for table in page.tables if table.rows],
        "charts": [chart for chart in page.charts if chart.curves],
        "unusual": (*page.unusual[:_MAX_UNUSUAL], *([Unusual(f"and {more} more")] if more > 0 else [])),
        "settings": yaml.safe_dump(dict(page.settings), sort_keys=False, allow_unicode=True),
        "versions": versions(),
        "written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }
    bare = template.render(**values, pictures=[])
    # Reserve for the pictures' captions.
    room_bytes = MAX_PAGE_BYTES - len(bare.encode()) - 500 * (len(page.pictures) + 1)
    text = template.render(**values, pictures=embed(page.pictures, room_bytes))
    write_whole(out / NAME, text)
    return NAME


def _cut(table: PageTable) -> PageTable:
    left = len(table.rows) - _MAX_ROWS
    if left <= 0:
        return table
    return replace(table, rows=table.rows[:_MAX_ROWS], note=f"{table.note} {left} more rows are not shown.".strip())


def _shorter(text: str) -> str:
    """Omit the middle of a long text: a traceback ends with its cause."""
    half = _MAX_TEXT // 2
    return text if len(text) <= _MAX_TEXT else f"{text[:half]}\n[...]\n{text[-half:]}"
