"""What a live run does under attacks and faults: `python -m benchmarks.faults --json FILE`.

First trackers that misbehave, in simulated time. Then runs on the real clock whose lines come through sockets from
another process: strangers, floods, long lines, wrong clocks; and parts that are slow or raise. Then parts that return,
raise or take what they must not, by families. `--busy 2` keeps two processors busy meanwhile. Each command is counted,
and the time between two of them measured.
"""

from __future__ import annotations

import json
import logging
import sys
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import tyro

from benchmarks.faults.live import LIVE_FAULTS, LiveCount, busy, run_live
from benchmarks.faults.parts import HOLDS_UP, PartCount, cases, isolation_ms, run_part
from benchmarks.faults.simulated import SIMULATED_FAULTS, WALKS, SimulatedCount, run_simulated

# Four servo periods.
_GAP_MS = 20.0


def count_all(
    seconds: float,
    cores: int,
    neck: str,
    live: tuple[str, ...],
    simulated: tuple[str, ...],
    walks: tuple[str, ...],
    parts: list[tuple[str, str]],
) -> dict[str, Any]:
    """Run everything, and print each row as it comes.

    Args:
        seconds: Length of each run on the real clock.
        cores: How many other processes compute meanwhile.
        neck: The neck.
        live: Faults on the real clock.
        simulated: Faults in simulated time.
        walks: Walks of these.
        parts: Families and kinds of parts that misbehave.

    Returns:
        All rows, and their sums.
    """
    in_simulation, on_the_clock, of_parts = [], [], []
    for fault, walk in product(simulated, walks):
        in_simulation.append(run_simulated(fault, walk, neck))
        _say(in_simulation[-1])
    with busy(cores):
        for fault in live:
            on_the_clock.append(run_live(fault, seconds, neck))
            _say(on_the_clock[-1])
        logging.disable(logging.WARNING)  # each fault, with its traceback
        for family, kind in parts:
            of_parts.append(run_part(family, kind, neck=neck))
            _say_part(of_parts[-1])
        logging.disable(logging.NOTSET)
    print("\n".join(table(of_parts)))
    p50_ms, p99_ms = isolation_ms()
    print(f"a forecast in a process of its own takes {p50_ms} ms (p50), {p99_ms} ms (p99) longer")
    rows: list[LiveCount | SimulatedCount | PartCount] = [*in_simulation, *on_the_clock, *of_parts]
    sums = {
        "runs": len(rows),
        "commands": sum(row.commands for row in rows),
        "outside_limits": sum(row.outside_limits for row in rows),
        "not_finite": sum(row.not_finite for row in on_the_clock),
        "gap_max_ms": max((row.gap_max_ms for row in on_the_clock), default=None),
        "runs_ended": sum(row.ended for row in of_parts),
        "logs_lost": sum(row.log_lost for row in of_parts),
    }
    return {
        "sums": sums,
        "isolation_ms": [p50_ms, p99_ms],
        "busy_processes": cores,
        "neck": neck,
        "simulated": [asdict(row) for row in in_simulation],
        "live": [asdict(row) for row in on_the_clock],
        "parts": [asdict(row) for row in of_parts],
    }


def table(rows: list[PartCount]) -> list[str]:
    """The families of parts as rows of a Markdown table; what no thread can help with in rows of its own.

    Args:
        rows: The runs.

    Returns:
        Lines.
    """
    lines = [
        "| part | kinds | runs ended | logs lost | outside limits | longest gap | kinds over 20 ms |",
        "|---|---|---|---|---|---|---|",
    ]
    groups: dict[str, list[PartCount]] = {}
    for row in rows:
        held = (row.family, row.kind) in HOLDS_UP
        groups.setdefault(f"{row.family}: {row.kind}" if held else row.family, []).append(row)
    for name, group in groups.items():
        ended, lost, outside = (sum(getattr(r, n) for r in group) for n in ("ended", "log_lost", "outside_limits"))
        gap_ms, over = max(row.gap_max_ms for row in group), sum(row.gap_max_ms > _GAP_MS for row in group)
        lines.append(f"| {name} | {len(group)} | {ended} | {lost} | {outside} | {gap_ms:.0f} ms | {over} |")
    return lines


def _say_part(row: PartCount) -> None:
    wrong = "".join([", ENDED" * row.ended, ", LOG LOST" * row.log_lost])
    print(
        f"{row.family + ': ' + row.kind:<50} {row.commands:4} commands, {row.outside_limits} outside limits, gap "
        f"{row.gap_max_ms:6.1f} ms{wrong}; {row.named[:150]}",
        flush=True,
    )


def _say(row: LiveCount | SimulatedCount) -> None:
    reasons = "".join(f", {count} {name}" for name, count in row.refused.items())
    gaps = f"gaps {row.gap_p99_ms:5.1f} p99, {row.gap_max_ms:5.1f} ms max, " if isinstance(row, LiveCount) else ""
    print(
        f"{row.fault:<44} {row.commands:5} commands, {row.outside_limits} outside limits, {gaps}"
        f"{row.gaze_error_rms_deg:6.2f} deg; {row.used} of {row.observations} used{reasons}",
        flush=True,
    )


def main(
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
    seconds: float = 6.0,
    busy: int = 0,
    neck: str = "reference",
    short: bool = False,
    only_parts: bool = False,
) -> int:
    """Count commands and the gaps between them under attacks and faults.

    Args:
        json_file: Where to write all figures.
        seconds: Length of each run on the real clock.
        busy: How many other processes compute meanwhile.
        neck: A neck with pan and tilt alone, whose axes and eye are in one point.
        short: A few faults only.
        only_parts: Only the parts that misbehave.
    """
    live: tuple[str, ...] = LIVE_FAULTS
    simulated: tuple[str, ...] = tuple(SIMULATED_FAULTS)
    walks: tuple[str, ...] = WALKS
    if short:
        live, simulated, walks = ("stranger", "clock_ahead"), ("stamps 100 ms ahead of the clock",), WALKS[:1]
    if only_parts:
        live, simulated = (), ()
    found = count_all(seconds, busy, neck, live, simulated, walks, list(cases(short)))
    print(", ".join(f"{name} {value}" for name, value in found["sums"].items()))
    if json_file is not None:
        json_file.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    bad = ("outside_limits", "not_finite", "runs_ended", "logs_lost")
    return int(any(found["sums"][name] for name in bad))


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
