"""What a live run does under attacks and faults: `python -m benchmarks.faults --json FILE`.

First trackers that misbehave, in simulated time. Then runs on the real clock whose lines come through sockets from
another process: strangers, floods, long lines, wrong clocks; and parts that are slow or raise. `--busy 2` keeps two
processors busy meanwhile. Each command is counted, and the time between two of them measured.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import tyro

from benchmarks.faults.live import LIVE_FAULTS, LiveCount, busy, run_live
from benchmarks.faults.simulated import SIMULATED_FAULTS, WALKS, SimulatedCount, run_simulated


def count_all(
    seconds: float, cores: int, neck: str, live: tuple[str, ...], simulated: tuple[str, ...], walks: tuple[str, ...]
) -> dict[str, Any]:
    """Run everything, and print each row as it comes.

    Args:
        seconds: Length of each run on the real clock.
        cores: How many other processes compute meanwhile.
        neck: The neck.
        live: Faults on the real clock.
        simulated: Faults in simulated time.
        walks: Walks of these.

    Returns:
        All rows, and their sums.
    """
    in_simulation, on_the_clock = [], []
    for fault, walk in product(simulated, walks):
        in_simulation.append(run_simulated(fault, walk, neck))
        _say(in_simulation[-1])
    with busy(cores):
        for fault in live:
            on_the_clock.append(run_live(fault, seconds, neck))
            _say(on_the_clock[-1])
    rows: list[LiveCount | SimulatedCount] = [*in_simulation, *on_the_clock]
    sums = {
        "runs": len(rows),
        "commands": sum(row.commands for row in rows),
        "outside_limits": sum(row.outside_limits for row in rows),
        "not_finite": sum(row.not_finite for row in on_the_clock),
        "gap_max_ms": max((row.gap_max_ms for row in on_the_clock), default=None),
    }
    return {
        "sums": sums,
        "busy_processes": cores,
        "neck": neck,
        "simulated": [asdict(row) for row in in_simulation],
        "live": [asdict(row) for row in on_the_clock],
    }


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
) -> int:
    """Count commands and the gaps between them under attacks and faults.

    Args:
        json_file: Where to write all figures.
        seconds: Length of each run on the real clock.
        busy: How many other processes compute meanwhile.
        neck: A neck with pan and tilt alone, whose axes and eye are in one point.
        short: A few faults only.
    """
    live: tuple[str, ...] = LIVE_FAULTS
    simulated: tuple[str, ...] = tuple(SIMULATED_FAULTS)
    walks: tuple[str, ...] = WALKS
    if short:
        live, simulated, walks = ("stranger", "clock_ahead"), ("stamps 100 ms ahead of the clock",), WALKS[:1]
    found = count_all(seconds, busy, neck, live, simulated, walks)
    print(", ".join(f"{name} {value}" for name, value in found["sums"].items()))
    if json_file is not None:
        json_file.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    return int(found["sums"]["outside_limits"] + found["sums"]["not_finite"] > 0)


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
