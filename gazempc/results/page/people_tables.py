"""Tables of a report on a run among several people, or with looks away."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from gazempc.results.attention import WORDS, measure_attention
from gazempc.results.figures.people import has_attention, looks_away, turns
from gazempc.results.log import Log
from gazempc.results.page.content import PageTable
from gazempc.results.run_summary import label

# A longer list is for the log, not for a page.
_MOST_ROWS = 40


def people_tables(logs: Mapping[str, Log]) -> tuple[PageTable, ...]:
    """Whom the gaze was for, and how well.

    Args:
        logs: Controller -> log of the same recording.

    Returns:
        The metrics, and the time line of the last run; nothing where the gaze was for one person all the time.
    """
    if not has_attention(logs):
        return ()
    found = [asdict(measure_attention(log)) for log in logs.values()]
    known = [name for name in WORDS if any(np.isfinite(each[name]) for each in found)]
    rows = tuple((WORDS[name][0], *(_cell(WORDS[name][1] * each[name]) for each in found)) for name in known)
    of_each = PageTable("People and looks away", ("", *map(label, logs)), rows)
    name, log = list(logs.items())[-1]
    whom = [(turn.from_s, turn.to_s, turn.texts[0]) for turn in turns(log)]
    away = [(from_s, to_s, f"looks away: {why}") for from_s, to_s, why in looks_away(log)]
    lines = tuple((f"{from_s:.2f}", f"{to_s:.2f}", what) for from_s, to_s, what in sorted(whom + away))
    note = f"The first {_MOST_ROWS} of {len(lines)}; all are in the log." if len(lines) > _MOST_ROWS else ""
    heading = f"Whom the gaze was for: {label(name)}"
    return of_each, PageTable(heading, ("from [s]", "to [s]", ""), lines[:_MOST_ROWS], note)


def _cell(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "-"
