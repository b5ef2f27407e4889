"""Fault injection in live runs: `python -m benchmarks.faults --json FILE`.

First tracker faults in simulated time. Then real-time runs with a tracker in another process, over sockets: forged
observations, floods, long lines, wrong clocks. Then parts with invalid results, exceptions and delays, by families.
`--busy 2` loads two processor cores. Commands are counted, and the gaps between them measured; an undisturbed reference
process measures the machine's own gaps.
"""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Annotated

import tyro

from benchmarks.faults.machine import busy as busy_processes
from benchmarks.faults.machine import control
from benchmarks.faults.runs import LIVE_FAULTS, Count, isolation_ms, run_live, run_part
from benchmarks.faults.simulated import SIMULATED_FAULTS, WALKS, run_simulated
from benchmarks.faults.wrongs import cases
from gazempc.results.page.content import PageTable

# Four servo periods.
_GAP_MS = 20.0
_BAD = ("outside_limits", "ended", "log_lost")
_SHORTEST_S = 1.2  # the gaze error of a shorter run is undefined


def table(rows: Sequence[Count]) -> list[str]:
    """The families of parts as rows of a Markdown table.

    The last column is the number of those gaps that coincide with one of an undisturbed process.

    Args:
        rows: The runs.

    Returns:
        Lines of the table.
    """
    heads = ("part", "kinds", *_BAD, "longest gap", f"over {_GAP_MS:g} ms", "the machine's")
    lines = []
    for family in dict.fromkeys(row.family for row in rows):
        group = [row for row in rows if row.family == family]
        over = [row for row in group if row.gap_max_ms > _GAP_MS]
        machines = sum(row.gap_max_ms - row.machine_gap_ms < _GAP_MS / 2 for row in over)
        longest = f"{max(row.gap_max_ms for row in group):.0f} ms"
        sums = (sum(getattr(row, name) for row in group) for name in _BAD)
        lines.append(tuple(map(str, (family, len(group), *sums, longest, len(over), machines))))
    return PageTable("", heads, tuple(lines)).markdown()


def _printed(row: Count) -> Count:
    wrong = {name: count for name in _BAD if (count := int(getattr(row, name)))} or "within limits"
    gap = f"gap {row.gap_max_ms:.1f} ms, the machine's {row.machine_gap_ms:.1f} ms"
    found = row.named[:150] or f"{row.gaze_error_rms_deg} deg; {row.used} of {row.observations} used; {row.refused}"
    print(f"{row.family + ': ' + row.kind:<50} {row.commands:5} commands, {wrong}, {gap}; {found}", flush=True)
    return row


def main(
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
    seconds: float = 6.0,
    busy: int = 0,
    short: bool = False,
    only_parts: bool = False,
) -> int:
    """Count commands and the gaps between them under attacks and faults.

    Args:
        json_file: File for all figures.
        seconds: Duration of each real-time run, at least 1.2; at most 1.8 with a faulty part.
        busy: Number of processes that load the processor.
        short: A few faults only.
        only_parts: Only the faulty parts.
    """
    if seconds < _SHORTEST_S:
        print(f"--seconds {seconds:g}: expected at least {_SHORTEST_S:g}", file=sys.stderr)
        return 2
    live, simulated = list(LIVE_FAULTS), list(product(SIMULATED_FAULTS, WALKS))
    if short:
        live, simulated = ["stranger", "clock_ahead"], [("stamps 100 ms ahead of the clock", WALKS[0])]
    if only_parts:
        live, simulated = [], []
    rows = [_printed(run_simulated(fault, walk)) for fault, walk in simulated]
    with busy_processes(busy), control() as machine_gap_ms:
        rows += [_printed(run_live(fault, seconds, machine_gap_ms)) for fault in live]
        logging.disable(logging.WARNING)  # each fault, with its traceback
        parts = [_printed(run_part(family, kind, machine_gap_ms, min(seconds, 1.8))) for family, kind in cases(short)]
        logging.disable(logging.NOTSET)
    print("\n".join(table(parts)))
    p50_ms, p99_ms = isolation_ms(200 if short else 2000)
    print(f"overhead of a forecast in a separate process: {p50_ms} ms (p50), {p99_ms} ms (p99)")
    rows += parts
    bad = {name: sum(getattr(row, name) for row in rows) for name in _BAD}
    print(f"runs {len(rows)}, commands {sum(row.commands for row in rows)}, {bad}")
    if json_file is not None:
        found = {"busy_processes": busy, "isolation_ms": [p50_ms, p99_ms], "rows": [asdict(row) for row in rows]}
        json_file.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    return int(any(bad.values()))


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
