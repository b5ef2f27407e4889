"""The least gaze error any controller could have on a neck: `python -m experiments.bound --recordings synthetic`.

Beside it stand look-ahead, the MPC and the MPC with the true future in the same place. What is left out of the bound is
said in `experiments.least_error`.
"""

from __future__ import annotations

if __name__ == "__main__":  # before the other imports, which are slow
    from experiments.engine.signals import end_during_imports

    end_during_imports("bound")

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from experiments.bound_page import bound_page
from experiments.clips import GROUP_ORDER
from experiments.engine.command import (
    NOT_SAVED,
    WorkSettings,
    check,
    command_of,
    exit_status,
    parse,
    run_command,
)
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.engine.recordings import find_recordings, in_place
from experiments.least_error import CONTROLLERS, BoundJob
from gazempc.files.whole import whole, write_whole
from gazempc.loop.build import walker_model
from gazempc.neck.spec import load_neck
from gazempc.recordings.placement import Placement
from gazempc.results.page.content import PageTable
from gazempc.results.page.write import write_page
from gazempc.results.run_summary import label, versions
from gazempc.settings import WalkerSettings
from gazempc.sim.scene import SceneSettings
from gazempc.sim.sensor import load_sensor

COLUMNS = (*CONTROLLERS, "bound")
GROUPS = (*GROUP_ORDER, "all")


class BoundSettings(WorkSettings, SceneSettings):
    """Settings of `python -m experiments.bound`."""

    recordings: tuple[str, ...] = Field(min_length=1, description="'synthetic', folders, files or synthetic names")
    neck: str = Field(default="slow", description="Shipped neck or .toml file")
    placement: Placement | None = Field(default="side", description="Where the robot stands")
    distance_m: float = Field(default=1.0, gt=0, description="Distance of the robot from the walk, for placement side")
    walker: WalkerSettings = WalkerSettings()
    out: Path = Field(default=Path("out/bound"), description="Where to write; an interrupted run goes on there")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 4 if a run failed, 2 on bad input, 130 if interrupted.
    """
    return run_command(
        "bound", lambda: _run(parse(BoundSettings, "bound", __doc__, arguments), command_of("bound", arguments))
    )


def bound(**settings: Any) -> list[Row]:
    """Find the least error on each recording.

    Args:
        **settings: Any of `BoundSettings`, such as ``recordings=["synthetic"], neck="slow"``.

    Returns:
        A row for each recording: ``group``, RMS errors in degrees of `COLUMNS`, ``left_out`` and ``failed``.

    Raises:
        GazempcError: On bad input, before anything runs.
    """
    return _bound(check(BoundSettings, "bound", settings))


def _bound(settings: BoundSettings) -> list[Row]:
    neck = load_neck(settings.neck)
    sensor = None if settings.sensor is None else load_sensor(settings.sensor)
    if settings.walker.fitted is not None:
        walker_model(settings.walker.fitted, "")  # before anything runs
    scene = SceneSettings(**{name: getattr(settings, name) for name in SceneSettings.model_fields})
    recordings = find_recordings(settings.recordings)
    jobs = [BoundJob(in_place(name), scene, neck, sensor, settings.walker) for name in recordings]
    with Engine(settings.out / "runs", settings.jobs, settings.dask, unit="walk") as engine:
        results = engine.run(jobs)
    return [{"recording": Path(name).stem, **row} for name, row in zip(recordings, results, strict=True)]


def _run(settings: BoundSettings, command: str) -> int:
    rows = _bound(settings)
    done = [row for row in rows if not row["left_out"] and not row["failed"]]
    failed = [row for row in rows if row["failed"]]
    summary = summarise(done)
    saved = settings.model_dump(mode="json", exclude={*NOT_SAVED})
    told = {"settings": saved, "versions": versions(), "rows": summary}
    write_whole(settings.out / "bound.json", json.dumps(told, indent=2) + "\n")
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with whole(settings.out / "bound.csv") as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
    table = _table(summary)
    write_page(bound_page(rows, COLUMNS, table, saved, command), settings.out)
    print(f"# Least gaze error of the neck {settings.neck}, {settings.distance_m:g} m beside the walk\n")
    n_left_out = len(rows) - len(done) - len(failed)
    print(f"RMS gaze error in degrees, means over clips; {n_left_out} recordings left out (too near, or too short).\n")
    print("\n".join([*table.markdown(), ""]))
    for row in failed:
        print(f"failed: {row['recording']}: {row['failed']}")
    print(f"Written to {settings.out}/: report.html, bound.json, bound.csv")
    return exit_status(False, bool(failed))


def summarise(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over clips, group by group.

    Args:
        rows: One for each recording: its group and the RMS errors in degrees of `COLUMNS`.

    Returns:
        A row for each group that has clips: number, mean errors, and the bound's share of look-ahead's error.
    """
    summary = []
    for group in GROUPS:
        chosen = [row for row in rows if group in (row["group"], "all")]
        if chosen:
            means = {name: float(np.mean([row[name] for row in chosen])) for name in COLUMNS}
            share = means["bound"] / means["lookahead"]
            summary.append({"group": group, "clips": len(chosen), **means, "bound_to_lookahead": share})
    return summary


def _table(summary: Sequence[dict[str, Any]]) -> PageTable:
    columns = ("group", "clips", *map(label, CONTROLLERS), "least possible", "below look-ahead")
    rows = []
    for row in summary:
        saved = 100.0 * (1.0 - row["bound_to_lookahead"])
        rows.append((row["group"], str(row["clips"]), *(f"{row[name]:.2f}" for name in COLUMNS), f"{saved:.1f} %"))
    return PageTable("RMS gaze error in degrees, means over clips", columns, tuple(rows))


if __name__ == "__main__":
    raise SystemExit(main())
