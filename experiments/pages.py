"""Files, text and notable events common to the reports of all experiments."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from gazempc.files.whole import whole, write_whole
from gazempc.loop.events import MEANINGS
from gazempc.results.page.content import Page, PageTable, Unusual
from gazempc.results.page.write import write_page
from gazempc.results.run_summary import versions


def seen_in_fitting(people: int) -> Iterator[Unusual]:
    """Note that results are in-sample for people in the fit of the predictor `walker`."""
    if people:
        yield Unusual(
            f"the predictor walker was fitted on {count(people, 'person', 'people')} of these recordings",
            "Its figures are optimistic; for people left out see --walker.fitted.",
        )


def unusual(summary: Mapping[str, Any], violations: int) -> Iterator[Unusual]:
    """Limit violations, failed runs, caught exceptions, and left-out recordings.

    Args:
        summary: With ``failed`` (``recording`` and reason of each), ``faults`` from
            `experiments.engine.replays.all_faults`, and ``left_out`` (reasons by recording).
        violations: Number of limit violations.
    """
    if violations:
        yield Unusual(f"{violations} violations of a neck's limits")
    for name, reason in dict.fromkeys((row["recording"], row["failed"]) for row in summary["failed"]):
        yield Unusual(f"failed {name}", reason)
    for fault in summary["faults"]:
        parts = ", ".join(str(fault[name]) for name in ("controller", "predictor") if name in fault)
        text = f"{MEANINGS.get(fault['event'], '')}: {fault['error']}".removeprefix(": ")
        what = f"{parts}: {fault['event']}, {fault['count']} x in {fault['runs']} runs"
        yield Unusual(what, text, fault["traceback"])
    yield from (Unusual(f"left out {name}", reason) for name, reason in summary["left_out"].items())


def count(n: int, one: str, many: str | None = None) -> str:
    """A number with its noun: ``1 person``, ``2 people``."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def table_of(title: str, rows: Iterable[Any], columns: Mapping[str, Callable[[Any], str]], note: str = "") -> PageTable:
    """A table with one line per row.

    Args:
        title: Heading.
        rows: The rows.
        columns: Function from row to cell text, by column heading.
        note: Text below the table.

    Returns:
        The table.
    """
    lines = tuple(tuple(cell(row) for cell in columns.values()) for row in rows)
    return PageTable(title, tuple(columns), lines, note)


def with_ends(value: float | None, ends: Sequence[float] | None, form: str, factor: float = 1.0) -> str:
    """A mean with its interval in brackets, in a format such as ``.2f``; ``-`` without one."""
    if value is None:
        return "-"
    between = "" if ends is None else f" [{', '.join(format(factor * end, form) for end in ends)}]"
    return f"{factor * value:{form}}{between}"


def markdown(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown, ending with a blank line."""
    return "\n".join([*PageTable("", tuple(head), tuple(map(tuple, rows))).markdown(), ""])


def text_of(page: Page) -> str:
    """A report as Markdown: summary, tables and notable events."""
    lines = [f"# {page.title}", "", *page.answer, "", *(page.setup[name] for name in ("how",) if name in page.setup)]
    for table in page.tables:
        lines += ["", *([f"## {table.title}", ""] if table.title else []), *table.markdown()]
        lines += ["", table.note] if table.note else []
    lines += ["", *(f"- {each.what}{f': {each.text}' if each.text else ''}" for each in page.unusual)]
    return "\n".join(lines).rstrip() + "\n"


def write_results(page: Page, out: Path, summary: Mapping[str, Any]) -> str:
    """Write ``report.html``, ``summary.json`` and ``summary.md`` of a comparison.

    Args:
        page: The report.
        out: The folder.
        summary: Content of the JSON file.

    Returns:
        The report as Markdown.
    """
    text = text_of(page)
    write_json(out / "summary.json", summary)
    write_whole(out / "summary.md", text)
    write_page(page, out)
    return text


def write_rows(path: Path, settings: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as JSON, with the settings and versions of the run."""
    write_json(path, {"settings": settings, "versions": versions(), "rows": rows})


def write_json(path: Path, content: Any) -> None:
    """Write plain data as JSON."""
    write_whole(path, json.dumps(content, indent=2) + "\n")


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV, without ``faults``, which are in `summary.json` only."""
    columns = list(dict.fromkeys(name for row in rows for name in row if name != "faults"))
    with whole(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
