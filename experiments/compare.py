"""Compare gazes over many recordings: `python -m experiments.compare --recordings synthetic --out out/compare`."""

from __future__ import annotations

if __name__ == "__main__":  # before the other imports, which are slow
    from gazempc.signals import end_during_imports

    end_during_imports("compare")

import itertools
import sys
from pathlib import Path
from typing import Any

from pydantic import Field

from experiments.aggregate import COMPARED, DIFFERENCES, add_gap_closed, paired_differences, summarise
from experiments.engine.command import (
    ChoiceSettings,
    Command,
    call_of,
    each_sensor,
    exit_status,
    find_recordings,
    in_place,
    name_parts,
    options_of,
)
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.engine.replays import ReplayJob, all_faults
from gazempc.loop.build import walker_model
from gazempc.neck.spec import load_neck
from gazempc.parts import gaze_of
from gazempc.results.run_summary import versions
from gazempc.settings import GAZES, GazeChoice
from gazempc.sim.replay import ReplaySettings
from gazempc.sim.scene import PlaceSettings


class CompareSettings(ChoiceSettings, PlaceSettings):
    """Settings of `python -m experiments.compare`."""

    controllers: tuple[GazeChoice, ...] = Field(
        default=GAZES,
        min_length=1,
        description="What to compare; module:Class for your own",
    )
    necks: tuple[str, ...] = Field(default=("reference",), min_length=1, description="Shipped necks or .toml files")
    out: Path = Field(default=Path("out/compare"), description="Where to write; an interrupted run goes on there")
    figures: bool = Field(default=True, description="Draw figures")


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
    checked = CompareSettings.of("compare", settings)
    rows = _replay_all(checked)
    write(checked, rows, call_of("experiments.compare.compare", settings))
    return rows


def _run(settings: CompareSettings, command: str) -> int:
    rows = _replay_all(settings)
    text, written = write(settings, rows, command)
    print(text)
    print(f"Written to {settings.out}/: {', '.join(written)}")
    return exit_status(any(row.get("limit_violations") for row in rows), any(row["failed"] for row in rows))


def _replay_all(settings: CompareSettings) -> list[Row]:
    labels, jobs = zip(*runs_of(settings), strict=True)
    with Engine(settings.out / "runs", settings.jobs, settings.dask) as engine:
        results = engine.run(jobs)
    rows = [label | result for label, result in zip(labels, results, strict=True)]
    for part in ("controller", "predictor"):
        name_parts(rows, part)
    add_gap_closed(rows)
    return rows


def runs_of(settings: CompareSettings) -> list[tuple[Row, ReplayJob]]:
    """Every combination on every recording, after checking all that can be checked before.

    Args:
        settings: What to compare.

    Returns:
        Labels and job of each run; the perfect forecast is run once for each neck and sensor, as it has no predictor.

    Raises:
        GazempcError: If a recording, neck, sensor or part does not exist.
    """
    recordings = find_recordings(settings.recordings)
    necks = {name: load_neck(name) for name in settings.necks}
    sensors = each_sensor(settings.sensors)
    predictors = settings.checked_predictors(*settings.controllers)
    place = {name: getattr(settings, name) for name in PlaceSettings.model_fields}
    runs: dict[tuple[str | None, ...], tuple[Row, ReplayJob]] = {}
    for recording, (sensor, by_name), (neck_name, neck), predictor, controller in itertools.product(
        recordings, sensors.items(), necks.items(), predictors, settings.controllers
    ):
        shown = gaze_of(controller)[1] or predictor
        options = options_of(controller, shown, settings.options)
        chosen = ReplaySettings(predictor=shown, walker=settings.walker, options=options, sensor=sensor, **place)
        labels = {
            **{"recording": Path(recording).stem, "source": recording},
            **dict.fromkeys(("data_kind", "subject", "group", "kind")),
            **{"controller": controller, "predictor": shown, "neck": neck_name},
            **{"sensor": None if sensor is None else by_name[sensor].name, "seed": settings.seed, "notes": None},
        }
        job = ReplayJob(in_place(recording), controller, chosen, neck, neck, by_name)
        runs.setdefault((recording, sensor, neck_name, shown, controller), (labels, job))
    return list(runs.values())


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
    # Slow to import.
    from experiments.compare_page import compare_page, plots_of  # noqa: PLC0415
    from experiments.pages import write_csv, write_results  # noqa: PLC0415
    from experiments.plots import draw  # noqa: PLC0415

    write_csv(settings.out / "results.csv", rows)
    summary = _summary(settings, rows, done)
    plots = dict(plots_of(done))
    drawn = {settings.out / name: plot for name, plot in plots.items() if settings.figures}
    for path, plot in drawn.items():
        draw([plot], path, "")
    text = write_results(compare_page(summary, done, plots.values(), drawn, command), settings.out, summary)
    files = ["report.html", "results.csv", "summary.json", "summary.md"]
    return text, [*files, *(path.name for path in drawn)]


def _summary(settings: CompareSettings, rows: list[Row], done: list[Row]) -> dict[str, Any]:
    left_out = {row["recording"]: row["left_out"] for row in rows if row["left_out"]}
    named = ("recording", "controller", "predictor", "neck", "sensor", "failed")
    failed = [{name: row[name] for name in named} for row in rows if row["failed"]]
    compared = list(COMPARED.items())[: None if settings.start_offset_deg else 1]
    return {
        "rows": summarise(done),
        **{
            f"{DIFFERENCES}{name}": paired_differences(done, metric, "mpc", "lookahead")
            for name, (metric, _, _) in compared
        },
        "n_left_out": len(left_out),
        "left_out": left_out,
        "failed": failed,
        "faults": all_faults(rows),
        "people_seen_in_fitting": _seen_in_fitting(settings, done),
        "seed": settings.seed,
        "settings": settings.saved("figures"),
        "versions": versions(),
    }


def _seen_in_fitting(settings: CompareSettings, done: list[Row]) -> list[str]:
    people = sorted({str(row["subject"]) for row in done if row["predictor"] == "walker"})
    fitted = settings.walker.fitted
    return [p for p in people if p in walker_model(fitted, p).about.get("people", ())]


main = Command("compare", CompareSettings, __doc__, _run).main

if __name__ == "__main__":
    sys.exit(main())
