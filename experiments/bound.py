"""The least gaze error any controller could have on a neck: `python -m experiments.bound --recordings synthetic`.

Printed beside look-ahead, the MPC and the MPC with the true future; RMS gaze error in degrees, means over clips. The
assumptions of the bound are those of `experiments.least_error`.
"""

from __future__ import annotations

if __name__ == "__main__":  # before the other imports, which are slow
    from gazempc.signals import end_during_imports

    end_during_imports("bound")

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from experiments.aggregate import GROUP_ORDER
from experiments.engine.choices import check_fitted, find_recordings, in_place
from experiments.engine.command import Command, WorkSettings, check, exit_status
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.least_error import CONTROLLERS, BoundJob
from experiments.pages import markdown, write_csv
from gazempc.files.whole import write_whole
from gazempc.neck.spec import load_neck
from gazempc.recordings.placement import Placement
from gazempc.results.run_summary import label, versions
from gazempc.settings import WalkerSettings
from gazempc.sim.scene import SceneSettings
from gazempc.sim.sensor import load_sensor

COLUMNS = (*CONTROLLERS, "bound")


class BoundSettings(WorkSettings, SceneSettings):
    """Settings of `python -m experiments.bound`."""

    recordings: tuple[str, ...] = Field(min_length=1, description="'synthetic', folders, files or synthetic names")
    neck: str = Field(default="slow", description="Shipped neck or .toml file")
    placement: Placement | None = Field(default="side", description="Where the robot stands")
    distance_m: float = Field(default=1.0, gt=0, description="Distance of the robot from the walk, for placement side")
    walker: WalkerSettings = WalkerSettings()
    out: Path = Field(default=Path("out/bound"), description="Where to write; an interrupted run goes on there")


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
    check_fitted(settings.walker)
    scene = SceneSettings(**{name: getattr(settings, name) for name in SceneSettings.model_fields})
    recordings = find_recordings(settings.recordings)
    jobs = [BoundJob(in_place(name), scene, neck, sensor, settings.walker) for name in recordings]
    with Engine(settings.out / "runs", settings.jobs, settings.dask, unit="walk") as engine:
        results = engine.run(jobs)
    return [{"recording": Path(name).stem, **row} for name, row in zip(recordings, results, strict=True)]


def _run(settings: BoundSettings, command: str) -> int:
    rows = _bound(settings)
    summary = summarise([row for row in rows if not row["left_out"] and not row["failed"]])
    saved = {"settings": settings.saved(), "versions": versions(), "rows": summary}
    write_csv(settings.out / "bound.csv", rows)
    write_whole(settings.out / "bound.json", json.dumps(saved, indent=2) + "\n")
    print(_table(summary))
    for row in rows:
        if reason := row["left_out"] or row["failed"]:
            print(f"- {'left out' if row['left_out'] else 'failed'} {row['recording']}: {reason}")
    print(f"Written to {settings.out}/: bound.json, bound.csv")
    return exit_status(False, any(row["failed"] for row in rows))


def summarise(rows: Sequence[Row]) -> list[Row]:
    """Means over clips, group by group.

    Args:
        rows: One for each recording: its group and the RMS errors in degrees of `COLUMNS`.

    Returns:
        A row for each group that has clips: number, mean errors, and the bound's share of look-ahead's error.
    """
    summary = []
    for group in (*GROUP_ORDER, "all"):
        chosen = [row for row in rows if group in (row["group"], "all")]
        if chosen:
            means = {name: float(np.mean([row[name] for row in chosen])) for name in COLUMNS}
            share = means["bound"] / means["lookahead"]
            summary.append({"group": group, "clips": len(chosen), **means, "bound_to_lookahead": share})
    return summary


def _table(summary: Sequence[Row]) -> str:
    cells = (
        (
            *(row["group"], str(row["clips"]), *(f"{row[name]:.2f}" for name in COLUMNS)),
            f"{100.0 * (1.0 - row['bound_to_lookahead']):.1f} %",
        )
        for row in summary
    )
    return markdown(("group", "clips", *map(label, CONTROLLERS), "least possible", "below look-ahead"), cells)


main = Command("bound", BoundSettings, __doc__, _run).main

if __name__ == "__main__":
    raise SystemExit(main())
