"""What the reports of all experiments share: files and text, curves over clips, and what went wrong."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.files.whole import whole, write_whole
from gazempc.loop.events import MEANINGS
from gazempc.results.page.content import Chart, Curve, Page, Unusual
from gazempc.results.page.write import write_page

SHARE_LABEL = "share of clips (%)"


def shares(title: str, x_label: str, clips: Mapping[tuple[str, str], Mapping[str, float]]) -> Chart:
    """For each error the share of clips that have no more than that.

    Args:
        title: What it is about.
        x_label: Name and unit of the error.
        clips: The error by clip, for each label and its CSS colour.

    Returns:
        The chart; a curve farther left is better.
    """
    return Chart(title, x_label, SHARE_LABEL, tuple(_share(*look, of_clip) for look, of_clip in clips.items()))


def _share(label: str, colour: str, of_clip: Mapping[str, float]) -> Curve:
    names = tuple(sorted(of_clip, key=of_clip.__getitem__))
    percent = 100.0 * np.arange(1, len(names) + 1) / max(len(names), 1)
    return Curve(label, colour, np.array([of_clip[name] for name in names], dtype=np.float64), percent, names)


def left_out(reasons: Mapping[str, str]) -> Iterator[Unusual]:
    """Recordings that were left out: recording -> reason."""
    yield from (Unusual(f"left out {name}", reason) for name, reason in reasons.items())


def failures(failed: Iterable[Mapping[str, Any]]) -> Iterator[Unusual]:
    """Runs that failed, each ``recording`` and its ``failed`` reason once."""
    for name, reason in dict.fromkeys((row["recording"], row["failed"]) for row in failed):
        yield Unusual(f"failed {name}", reason)


def survived(faults: Iterable[Mapping[str, Any]]) -> Iterator[Unusual]:
    """Exceptions that runs survived, as of `experiments.engine.replays.all_faults`."""
    for fault in faults:
        parts = ", ".join(str(fault[name]) for name in ("controller", "predictor") if name in fault)
        text = f"{MEANINGS.get(fault['event'], '')}: {fault['error']}".removeprefix(": ")
        what = f"{parts}: {fault['event']}, {fault['count']} x in {fault['runs']} runs"
        yield Unusual(what, text, fault["traceback"])


def count(n: int, one: str, many: str | None = None) -> str:
    """A number with its noun: ``1 person``, ``2 people``."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def text_of(page: Page) -> str:
    """A report as Markdown: the answer, the tables and what was unusual."""
    lines = [f"# {page.title}", "", *page.answer, "", *(page.setup[name] for name in ("how",) if name in page.setup)]
    for table in page.tables:
        lines += ["", *([f"## {table.title}", ""] if table.title else []), *table.markdown()]
        lines += ["", table.note] if table.note else []
    lines += ["", *(f"- {each.what}{f': {each.text}' if each.text else ''}" for each in page.unusual)]
    return "\n".join(lines).rstrip() + "\n"


def write_results(page: Page, out: Path, summary: Mapping[str, Any], name: str = "summary") -> str:
    """Write ``report.html``, ``<name>.json`` and ``<name>.md`` of a comparison.

    Args:
        page: The report.
        out: The folder.
        summary: Content of the JSON file.
        name: Of the files.

    Returns:
        The report as Markdown.
    """
    text = text_of(page)
    write_whole(out / f"{name}.json", json.dumps(summary, indent=2) + "\n")
    write_whole(out / f"{name}.md", text)
    write_page(page, out)
    return text


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV, without ``faults``, which have a place in `summary.json` only."""
    columns = list(dict.fromkeys(name for row in rows for name in row if name != "faults"))
    with whole(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
