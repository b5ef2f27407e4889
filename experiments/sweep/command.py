"""Sweep settings by their dotted names: `python -m experiments.sweep experiments/studies/pareto.yaml`."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import tyro
from pydantic import BaseModel, ConfigDict, Field

from experiments.engine.command import run_command
from experiments.engine.jobs import program_hash
from experiments.sweep.designs import Point
from experiments.sweep.figures import draw_all, recorded_or_synthetic
from experiments.sweep.plan import SweepPlan, load_plan, shipped_studies
from experiments.sweep.runner import Run, Runner, cluster, local
from experiments.sweep.spec import Case
from experiments.sweep.tables import Row, objective_means, pareto_front, point_table, run_row, text_table, write_table
from experiments.sweep.tuning import check_installed, tune
from experiments.sweep.variants import resolve
from gazempc.results.report import versions
from gazempc.settings import WalkerSettings


class SweepSettings(BaseModel):
    """Settings of `python -m experiments.sweep`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sweep: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SWEEP.yaml")] = Field(
        description=f"A sweep file, or a shipped study: {', '.join(shipped_studies())}"
    )
    recordings: tuple[str, ...] | None = Field(
        default=None, min_length=1, description="In place of the file's: 'synthetic', folders, files or synthetic names"
    )
    walker: WalkerSettings = WalkerSettings()
    jobs: int = Field(default=os.cpu_count() or 1, ge=1, description="Worker processes on this machine")
    dask: str | None = Field(default=None, description="Scheduler of a dask.distributed cluster that does the runs")
    out: Path | None = Field(default=None, description="Where to write, and to go on; without it out/sweep/<name>")
    figures: bool = Field(default=True, description="Draw figures")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 1 if runs failed or left the limits, 2 on bad input, 130 if interrupted.
    """
    settings = tyro.cli(SweepSettings, args=arguments, prog="python -m experiments.sweep", description=__doc__)
    return run_command("sweep", lambda: sweep(settings))


def sweep(settings: SweepSettings) -> int:
    """Do all runs and write tables and figures.

    Args:
        settings: What to sweep and where.

    Returns:
        Exit status, see `main`.

    Raises:
        GazempcError: On bad input, before anything runs; or if worker processes die, with what was done kept.
    """
    plan = load_plan(settings.sweep, settings.recordings, settings.walker.fitted)
    if any(case.design == "optuna" for case in plan.spec.all_cases()):
        check_installed()
    workers = cluster(settings.dask) if settings.dask else local(settings.jobs)
    out = settings.out or Path("out/sweep") / plan.spec.name
    started_s = time.monotonic()
    with workers as evaluate:
        runner = Runner(out / "runs", evaluate, _count(plan))
        try:
            rows = _do(plan, runner, out)
        finally:
            runner.close()
    wall_s = time.monotonic() - started_s

    table = point_table(plan, rows)
    write_table(out / "results.csv", rows)
    write_table(out / "table.csv", table)
    summary = _summary(plan, rows, table)
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    if settings.figures and table:
        draw_all(plan, rows, table, out)
    _print(plan, summary, table)
    if runner.simulated_s:
        rate = runner.simulated_s / wall_s
        each = "" if settings.dask else f", {rate / settings.jobs:.1f} a second and worker"
        print(f"{runner.simulated_s:.0f} simulated seconds in {wall_s:.0f} s: {rate:.1f} a second{each}")
    print(f"Written to {out}/: results.csv, table.csv, summary.json and figures")
    return 1 if summary["failed"] or any(row["limit_violations"] for row in rows) else 0


def _count(plan: SweepPlan) -> int:
    tuned = sum(case.n or 0 for case in plan.spec.all_cases() if case.design == "optuna")
    return len(plan.walks) * (tuned + sum(map(len, plan.points.values())))


def _do(plan: SweepPlan, runner: Runner, out: Path) -> list[Row]:
    # All points that are known go to the workers at once; those of a tuning follow batch by batch.
    known = [(case, i, point) for case in plan.spec.all_cases() for i, point in enumerate(plan.points[case.name])]
    rows = _rows(plan, runner, known)
    for case in (case for case in plan.spec.all_cases() if case.design == "optuna"):

        def score(points: Sequence[Point], case: Case = case) -> list[list[float] | None]:
            scored = _rows(plan, runner, [(case, i, point) for i, point in enumerate(points)])
            chunks = [[row for row in scored if row["point"] == i] for i in range(len(points))]
            return [objective_means(chunk, plan.spec.objectives) for chunk in chunks]

        points = tune(plan, case, out / "optuna.log", score)
        rows += _rows(plan, runner, [(case, i, point) for i, point in enumerate(points)])
    return rows


def _rows(plan: SweepPlan, runner: Runner, points: Sequence[tuple[Case, int, Point]]) -> list[Row]:
    now = program_hash()
    variants = [resolve({**case.base, **point}) for case, _, point in points]
    results = iter(runner.run([Run(walk, variant, now) for variant in variants for walk in plan.walks]))
    return [run_row(plan, *point, walk, next(results)) for point in points for walk in plan.walks]


def _summary(plan: SweepPlan, rows: list[Row], table: list[Row]) -> dict[str, Any]:
    overall = [row for row in table if row["group"] == "all"]
    objectives = plan.spec.objectives
    labels = ("case", "point", "controller", *plan.spec.varied())
    cases = plan.spec.all_cases()
    fronts = {case.name: pareto_front((r for r in overall if r["case"] == case.name), objectives) for case in cases}
    if len(cases) > 1:
        fronts["all cases"] = pareto_front(overall, objectives)
    shown = [*labels, *(o.metric for o in objectives)]
    return {
        "spec": plan.spec.model_dump(mode="json"),
        "seed": plan.spec.seed,
        "versions": versions(),
        "n_recordings": len(plan.walks),
        "n_runs": len(rows),
        "left_out": {row["recording"]: row["left_out"] for row in rows if row["left_out"]},
        "failed": [{k: row[k] for k in (*labels, "recording", "failed")} for row in rows if row["failed"]],
        "limit_violations": sum(row["limit_violations"] or 0 for row in rows),
        "pareto": {name: [{k: row[k] for k in shown} for row in front] for name, front in fronts.items()},
        "rows": table,
    }


def _print(plan: SweepPlan, summary: dict[str, Any], table: list[Row]) -> None:
    print(f"{plan.spec.name}: {' '.join(plan.spec.question.split())}".rstrip(": "))
    people = len({walk.subject for walk in plan.walks})
    print(f"{recorded_or_synthetic(plan)} of {people} {'people' if people > 1 else 'person'}; means over clips")
    print(text_table(plan, table))
    print(
        f"{summary['n_runs']} runs, {len(summary['failed'])} failed, {len(summary['left_out'])} recordings left out "
        f"somewhere, {summary['limit_violations']} limit violations"
    )
    for failure in summary["failed"][:5]:
        print(f"failed: {failure['case']} {failure['recording']}: {failure['failed']}")


if __name__ == "__main__":
    sys.exit(main())
