"""Compare gazes over many recordings: `python -m experiments.compare --recordings synthetic --out out/compare`."""

from __future__ import annotations

if __name__ == "__main__":  # before the other imports, which are slow
    from experiments.engine.signals import end_during_imports

    end_during_imports("compare")

import csv
import itertools
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from pydantic import Field

from experiments.aggregate import add_gap_closed, paired_differences, summarise
from experiments.compare_report import COMPARED, report
from experiments.engine.command import (
    NOT_SAVED,
    WorkSettings,
    call_of,
    check,
    command_of,
    exit_status,
    parse,
    run_command,
    throughput,
)
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.engine.own_parts import check_parts, name_parts, options_of
from experiments.engine.recordings import find_recordings, in_place
from experiments.engine.replays import ReplayJob, all_faults, each_sensor
from gazempc.files.whole import whole, write_whole
from gazempc.loop.build import walker_model
from gazempc.neck.spec import load_neck
from gazempc.results.run_summary import versions
from gazempc.settings import DEFAULT_PREDICTOR, ControllerChoice, PredictorChoice, WalkerSettings
from gazempc.sim.replay import ReplaySettings
from gazempc.sim.scene import PlaceSettings


class CompareSettings(WorkSettings, PlaceSettings):
    """Settings of `python -m experiments.compare`."""

    recordings: tuple[str, ...] = Field(
        min_length=1, description="'synthetic' (14 x 6), 'everyday' (14 x 5), folders, files or synthetic names"
    )
    controllers: tuple[ControllerChoice, ...] = Field(
        default=("reactive", "lookahead", "mpc", "perfect"),
        min_length=1,
        description="What to compare; module:Class for your own",
    )
    predictors: tuple[PredictorChoice | Literal["default"], ...] = Field(
        default=("default",), min_length=1, description="Forecasts; default is the run command's; module:Class"
    )
    sensors: tuple[str, ...] = Field(
        default=(),
        description="Shipped sensors or .toml files; without them each recording's own if tracked, else reference",
    )
    necks: tuple[str, ...] = Field(default=("reference",), min_length=1, description="Shipped necks or .toml files")
    walker: WalkerSettings = WalkerSettings()
    options: Annotated[dict[str, Any], tyro.conf.Suppress] = Field(
        default={}, description="Options of parts of your own: --options.KEY VALUE, for a parameter of the constructor"
    )
    out: Path = Field(default=Path("out/compare"), description="Where to write; an interrupted run goes on there")
    figures: bool = Field(default=True, description="Draw figures")


@dataclass(frozen=True)
class Compared:
    """One run of a comparison: its labels, and the job."""

    labels: dict[str, Any]
    job: ReplayJob


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 1 if runs left the limits, 4 if runs failed, 2 on bad input, 130 if interrupted.
    """
    return run_command(
        "compare", lambda: _run(parse(CompareSettings, "compare", __doc__, arguments), command_of("compare", arguments))
    )


def compare(**settings: Any) -> list[Row]:
    """Do all runs, and write tables and figures.

    Args:
        **settings: Any of `CompareSettings`, such as ``recordings=["synthetic"], controllers=["lookahead", "mpc"]``.

    Returns:
        A row for each run: labels, ``left_out`` and ``failed`` (the reason, or None), all metrics, and ``faults`` if
        exceptions were survived.

    Raises:
        GazempcError: On bad input, before anything runs.
    """
    checked = check(CompareSettings, "compare", settings)
    rows, _ = _replay_all(checked)
    write(checked, rows, call_of("experiments.compare.compare", settings))
    return rows


def _run(settings: CompareSettings, command: str) -> int:
    started_s = time.monotonic()
    rows, simulated_s = _replay_all(settings)
    wall_s = time.monotonic() - started_s
    text, written = write(settings, rows, command)
    print(text)
    print(throughput(simulated_s, wall_s, settings), end="")
    print(f"Written to {settings.out}/: {', '.join(written)}")
    return exit_status(any(row.get("limit_violations") for row in rows), any(row["failed"] for row in rows))


def _replay_all(settings: CompareSettings) -> tuple[list[Row], float]:
    runs = runs_of(settings)
    with Engine(settings.out / "runs", settings.jobs, settings.dask) as engine:
        results = engine.run([run.job for run in runs])
    rows = [run.labels | result for run, result in zip(runs, results, strict=True)]
    for part in ("controller", "predictor"):
        name_parts(rows, part)
    add_gap_closed(rows)
    return rows, sum(row.get("simulated_s", 0.0) for row in engine.fresh)


def runs_of(settings: CompareSettings) -> list[Compared]:
    """Every combination on every recording, after checking all that can be checked before.

    Args:
        settings: What to compare.

    Returns:
        The runs; the perfect forecast is run once for each neck and sensor, as it has no predictor.

    Raises:
        GazempcError: If a recording, neck, sensor or part does not exist.
    """
    recordings = find_recordings(settings.recordings)
    necks = {name: load_neck(name) for name in settings.necks}
    sensors = each_sensor(settings.sensors)
    predictors = dict.fromkeys(DEFAULT_PREDICTOR if p == "default" else p for p in settings.predictors)
    check_parts(settings.controllers, predictors, settings.options)
    if settings.walker.fitted is not None:
        walker_model(settings.walker.fitted, "")  # before anything runs
    runs: dict[tuple[str | None, ...], Compared] = {}
    for recording, (sensor, by_name), (neck_name, neck), predictor, controller in itertools.product(
        recordings, sensors.items(), necks.items(), predictors, settings.controllers
    ):
        shown = "perfect" if controller == "perfect" else predictor
        chosen = _settings_of(settings, controller, shown, sensor)
        job = ReplayJob(in_place(recording), controller, chosen, neck, neck, by_name)
        labels = _labels(job, recording, neck_name)
        runs.setdefault((recording, sensor, neck_name, shown, controller), Compared(labels, job))
    return list(runs.values())


def _settings_of(settings: CompareSettings, controller: str, predictor: str, sensor: str | None) -> ReplaySettings:
    place = {name: getattr(settings, name) for name in PlaceSettings.model_fields}
    options = options_of(controller, predictor, settings.options)
    return ReplaySettings(predictor=predictor, walker=settings.walker, options=options, sensor=sensor, **place)


def _labels(job: ReplayJob, recording: str, neck: str) -> dict[str, Any]:
    chosen = job.settings.sensor
    return {
        "recording": Path(recording).stem,
        "source": recording,
        "data_kind": None,
        "subject": None,
        "group": None,
        "kind": None,
        "controller": job.controller,
        "predictor": job.settings.predictor,
        "neck": neck,
        "sensor": None if chosen is None else job.sensors[chosen].name,
        "seed": job.settings.seed,
        "notes": None,
    }


def write(settings: CompareSettings, rows: list[Row], command: str) -> tuple[str, list[str]]:
    """Write ``results.csv``, ``summary.json``, ``summary.md``, ``report.html`` and figures.

    Args:
        settings: What was compared.
        rows: As `compare` returns them.
        command: What repeats it.

    Returns:
        The text of ``summary.md``, and the names of the files.
    """
    done = [row for row in rows if not row["left_out"] and not row["failed"]]
    columns = list(dict.fromkeys(name for row in rows for name in row if name != "faults"))
    with whole(settings.out / "results.csv") as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    summary = _summary(settings, rows, done)
    write_whole(settings.out / "summary.json", json.dumps(summary, indent=2) + "\n")
    text = report(summary, done)
    write_whole(settings.out / "summary.md", text)
    # Slow to import.
    from experiments.compare_figures import draw_all  # noqa: PLC0415
    from experiments.compare_page import compare_page  # noqa: PLC0415
    from gazempc.results.page.write import write_page  # noqa: PLC0415

    drawn = draw_all(summary["rows"], done, settings.out) if settings.figures and done else []
    write_page(compare_page(summary, done, drawn, command), settings.out)
    files = ["report.html", "results.csv", "summary.json", "summary.md"]
    return text, [*files, *(path.name for path in drawn)]


def _summary(settings: CompareSettings, rows: list[Row], done: list[Row]) -> dict[str, Any]:
    left_out = {row["recording"]: row["left_out"] for row in rows if row["left_out"]}
    told = ("recording", "controller", "predictor", "neck", "sensor", "failed")
    failed = [{name: row[name] for name in told} for row in rows if row["failed"]]
    compared = list(COMPARED.items())[: None if settings.start_offset_deg else 1]
    return {
        "rows": summarise(done),
        **{
            f"mpc_minus_lookahead_{name}": paired_differences(done, metric, "mpc", "lookahead")
            for name, (metric, _, _) in compared
        },
        "n_left_out": len(left_out),
        "left_out": left_out,
        "failed": failed,
        "faults": all_faults(rows),
        "people_seen_in_fitting": _seen_in_fitting(settings, done),
        "seed": settings.seed,
        "settings": settings.model_dump(mode="json", exclude={*NOT_SAVED, "figures"}),
        "versions": versions(),
    }


def _seen_in_fitting(settings: CompareSettings, done: list[Row]) -> list[str]:
    people = sorted({str(row["subject"]) for row in done if row["predictor"] == "walker"})
    fitted = settings.walker.fitted
    return [p for p in people if p in walker_model(fitted, p).about.get("people", ())]


if __name__ == "__main__":
    sys.exit(main())
