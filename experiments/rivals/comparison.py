"""Compare control laws of other robots and cameras with this project's: `python -m experiments.rivals`.

Without `--recordings` the walks are synthetic. Each rival detects faces in a camera on the moving head, at its own
rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import tyro
from pydantic import Field

from experiments.engine.command import Command, WorkSettings, check_fitted, exit_status, find_recordings, in_place
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.pages import write_rows
from experiments.plots import draw
from experiments.rivals import plan
from experiments.rivals.jobs import NAMES, RivalJob, check_names
from experiments.rivals.simulate import on_the_head
from experiments.rivals.trials import TRIALS, TURNS
from gazempc.files.whole import write_whole
from gazempc.neck.spec import load_neck
from gazempc.results.page.content import PageTable
from gazempc.settings import WalkerSettings
from gazempc.sim.sensor import load_sensor

# Seven people on a straight route, in a sharp turn and in a turn: a quarter of the set, which takes about ten minutes.
SYNTHETIC = tuple(f"subject{person:02}_{route}" for person in range(1, 8) for route in ("R1", "R4", "R5"))
STANDING = tuple(f"subject{person:02}_stand" for person in range(1, 8))
_WRONG_TRIALS = ("pass_2.5m", TURNS)


class RivalsSettings(WorkSettings):
    """Settings of `python -m experiments.rivals`."""

    recordings: tuple[str, ...] = Field(
        default=(), description="Walks: 'synthetic', folders, files or synthetic names; default: 21 synthetic ones"
    )
    standing: tuple[str, ...] = Field(
        default=(), description="People who stand or sit: folders or files; default: seven synthetic standing people"
    )
    necks: tuple[str, ...] = Field(
        default=("reference", "reachy_mini", "ptz"), min_length=1, description="Shipped necks or .toml files"
    )
    sensors: tuple[str, ...] = Field(
        default=("face_camera",), min_length=1, description="Shipped sensors or .toml files, mounted on the head"
    )
    rivals: tuple[str, ...] = Field(default=NAMES, min_length=1, description="Control laws")
    trials: tuple[str, ...] = Field(default=TRIALS, min_length=1, description="Trials")
    walker: WalkerSettings = WalkerSettings()
    wrong_model: bool = Field(
        default=False, description="Instead: effect of errors of dead time, servo and latency, on the first neck"
    )
    seed: int = Field(default=0, ge=0, description="Seed of all errors")
    rows: Annotated[Path | None, tyro.conf.arg(name="json")] = Field(
        default=None, description="File for the rows; default: rows.json in the output folder"
    )
    out: Path = Field(default=Path("out/rivals"), description="Output folder; an interrupted run resumes from it")


def rivals(**settings: Any) -> list[Row]:
    """Compare control laws.

    Args:
        **settings: Any of `RivalsSettings`, such as ``necks=["reachy_mini"], rivals=["reachy_mini", "mpc"]``.

    Returns:
        Rows of `experiments.rivals.plan.summarise`.

    Raises:
        GazempcError: On invalid input, before any run.
    """
    runs, _, _ = _done(RivalsSettings.of("rivals", settings))
    return plan.summarise(plan.at_their_best(runs))


def _jobs(settings: RivalsSettings) -> list[RivalJob]:
    check_names("rival", settings.rivals, NAMES)
    check_names("trial", settings.trials, tuple(TRIALS))
    necks = [load_neck(name) for name in settings.necks]
    sensors = [on_the_head(load_sensor(name)) for name in settings.sensors]
    check_fitted(settings.walker)
    walks, standing = (
        [in_place(name) for name in find_recordings(words)]
        for words in (settings.recordings or SYNTHETIC, settings.standing or STANDING)
    )
    if settings.wrong_model:
        return plan.make_jobs(settings.rivals, walks, necks[:1], sensors[:1], settings.seed, _WRONG_TRIALS)
    return plan.make_jobs(settings.rivals, walks, necks, sensors, settings.seed, settings.trials, standing)


def _done(settings: RivalsSettings) -> tuple[list[Row], list[Row], int]:
    """Runs with metrics, failed runs, and number of left-out ones."""
    jobs = [replace(job, walker=settings.walker) for job in _jobs(settings)]
    with Engine(settings.out / "runs", settings.jobs, settings.dask, unit="run") as engine:
        runs = plan.labelled(jobs, engine.run(jobs))
        if settings.wrong_model:
            wrong = plan.wrong_jobs(jobs, runs)
            runs += plan.labelled(wrong, engine.run(wrong))
    failed = [run for run in runs if run["failed"]]
    done = [run for run in runs if not run["failed"] and not run["left_out"]]
    return done, failed, len(runs) - len(done) - len(failed)


def _run(settings: RivalsSettings, command: str) -> int:
    done, failed, left_out = _done(settings)
    rows, tables, pictures = _wrong_model(done) if settings.wrong_model else _gazes(settings, done)
    path = settings.rows or settings.out / "rows.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_rows(path, settings.saved("rows"), rows)
    lines = ["Means over clips, in brackets 95 % bootstrap intervals over people; the best first.", ""]
    for table in tables:
        lines += [f"## {table.title}", "", *table.markdown(), ""]
    lines += [f"- failed: {run['rival']}, {run['trial']}, {run['recording']}: {run['failed']}" for run in failed]
    text = "\n".join([*lines, f"{left_out} runs left out: walks too near or too short.", f"`{command}`", ""])
    write_whole(settings.out / "tables.md", text)
    print(text)
    print(f"Written to {settings.out}/: tables.md{''.join(f', {picture.name}' for picture in pictures)}; and {path}")
    return exit_status(False, bool(failed))


def _gazes(settings: RivalsSettings, runs: Sequence[Row]) -> tuple[list[Row], list[PageTable], list[Path]]:
    rows, drawn = plan.summarise(plan.at_their_best(runs)), []
    for sensor in dict.fromkeys(row["sensor"] for row in rows if row["trial"] == plan.ALL_WALKS):
        drawn.append(settings.out / f"contact_{sensor}.png")
        plots = plan.contact_plots([row for row in rows if row["sensor"] == sensor])
        draw(plots, drawn[-1], f"walks, sensor {sensor}", log_x=True)
    return rows, plan.page_tables(rows), drawn


def _wrong_model(runs: Sequence[Row]) -> tuple[list[Row], list[PageTable], list[Path]]:
    found = plan.by_error([run for run in runs if run["rival"] in plan.WITH_MODEL])
    level = plan.summarise(plan.at_their_best([run for run in runs if run["rival"] in plan.WITHOUT_MODEL]))
    shown = {plan.LABELS[name]: [row for row in rows if row["trial"] == plan.ALL_WALKS] for name, rows in found.items()}
    rows = [*(row for rows in found.values() for row in rows), *level]
    return rows, plan.error_tables(shown, [row for row in level if row["trial"] == plan.ALL_WALKS]), []


main = Command("rivals", RivalsSettings, __doc__, _run).main
