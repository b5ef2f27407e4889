"""The least gaze error any controller could have on a neck: `python -m experiments.bound --recordings synthetic`.

Beside it stand look-ahead, the MPC and the MPC with the true future in the same place. The assumptions of the bound are
those of `experiments.least_error`.
"""

from __future__ import annotations

if __name__ == "__main__":  # before the other imports, which are slow
    from gazempc.signals import end_during_imports

    end_during_imports("bound")

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
from experiments.pages import failures, left_out, shares, write_csv, write_results
from gazempc.neck.spec import load_neck
from gazempc.recordings.placement import Placement
from gazempc.results.figures.style import COLOURS, styles
from gazempc.results.page.content import Page, PageTable
from gazempc.results.run_summary import label, versions
from gazempc.settings import WalkerSettings
from gazempc.sim.scene import SceneSettings
from gazempc.sim.sensor import load_sensor

COLUMNS = (*CONTROLLERS, "bound")
_NAMES = {name: label(name) for name in CONTROLLERS} | {"bound": "least possible"}
_TITLE = "RMS gaze error in degrees, means over clips"


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
    done = [row for row in rows if not row["left_out"] and not row["failed"]]
    failed = [row for row in rows if row["failed"]]
    summary, saved = summarise(done), settings.saved()
    write_csv(settings.out / "bound.csv", rows)
    page = _page(rows, done, summary, saved, command)
    print(write_results(page, settings.out, {"settings": saved, "versions": versions(), "rows": summary}, "bound"))
    print(f"Written to {settings.out}/: report.html, bound.json, bound.md, bound.csv")
    return exit_status(False, bool(failed))


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


def _page(rows: Sequence[Row], done: Sequence[Row], summary: Sequence[Row], saved: Row, command: str) -> Page:
    cells = tuple(
        (
            *(row["group"], str(row["clips"]), *(f"{row[name]:.2f}" for name in COLUMNS)),
            f"{100.0 * (1.0 - row['bound_to_lookahead']):.1f} %",
        )
        for row in summary
    )
    table = PageTable(_TITLE, ("group", "clips", *_NAMES.values(), "below look-ahead"), cells)
    colours = {name: look.colour for name, look in styles(CONTROLLERS).items()} | {"bound": COLOURS[-1]}
    clips = {(_NAMES[name], colours[name]): {row["recording"]: row[name] for row in done} for name in COLUMNS}
    means = ", ".join(f"{_NAMES[name]} {summary[-1][name]:.2f}" for name in COLUMNS if summary)
    near = {row["recording"]: row["left_out"] for row in rows if row["left_out"]}
    return Page(
        title="Least gaze error",
        question="How much of the gaze error is due to the neck's limits, and no controller can avoid it?",
        answer=(f"Mean RMS gaze error in degrees: {means}.",) if means else (),
        setup={
            "neck": str(saved["neck"]),
            "sensor": str(saved["sensor"] or "the one that fits each recording"),
            "robot": f"{saved['distance_m']:g} m beside the walk",
            "recordings": ", ".join(saved["recordings"]),
            "seed": str(saved["seed"]),
        },
        tables=(table,),
        charts=(shares("Clips by gaze error", "RMS gaze error of a clip (deg)", clips),),
        unusual=(*failures(row for row in rows if row["failed"]), *left_out(near)),
        command=command,
        settings=saved,
    )


main = Command("bound", BoundSettings, __doc__, _run).main

if __name__ == "__main__":
    raise SystemExit(main())
