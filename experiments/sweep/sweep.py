"""Sweep settings by their dotted names: `python -m experiments.sweep experiments/studies/pareto.yaml`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from pydantic import Field

from experiments.engine.command import Command, WorkSettings, check_optuna, exit_status, name_parts
from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.engine.replays import all_faults
from experiments.pages import write_csv, write_results
from experiments.plots import draw
from experiments.sweep import page
from experiments.sweep.names import resolve
from experiments.sweep.plan import Point, SweepPlan, case_seed, is_whole, load_plan, shipped_studies
from experiments.sweep.spec import Case, Range
from gazempc.results.run_summary import versions
from gazempc.settings import WalkerSettings

# Number of trials proposed together and evaluated in parallel. Independent of the number of workers, so that the trials
# are the same on all machines.
BATCH = 8

# Means of the objectives for each point; None if a run failed.
Score = Callable[[Sequence[Point]], list[list[float] | None]]


def tune(plan: SweepPlan, case: Case, score: Score) -> list[Point]:
    """Propose points by a multi-objective tree-structured Parzen estimator and score them, `BATCH` at a time.

    Each batch depends on the earlier batches and its own seed only. With cached results, an interrupted tuning repeats
    the same proposals and resumes.

    Args:
        plan: The sweep.
        case: The case, complete.
        score: Objective function of a batch of points.

    Returns:
        The ``n`` points in the order of the trials.

    Raises:
        MissingOptionalDependencyError: If Optuna is not installed.
    """
    import optuna  # noqa: PLC0415
    from optuna.trial import TrialState, create_trial  # noqa: PLC0415

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    space = {name: _distribution(name, entry) for name, entry in case.vary.items()}
    wanted = case.n or 0
    points: list[Point] = []
    finished: list[Any] = []  # Optuna's trials
    for start in range(0, wanted, BATCH):
        batch = _propose(plan, case, finished, space)[: wanted - start]
        for point, values in zip(batch, score(batch), strict=True):
            state = TrialState.FAIL if values is None else TrialState.COMPLETE
            finished.append(create_trial(state=state, params=point, distributions=space, values=values))
        points += batch
    return points


def _propose(plan: SweepPlan, case: Case, finished: Sequence[Any], space: dict[str, Any]) -> list[Point]:
    import optuna  # noqa: PLC0415

    seed = np.random.SeedSequence([*case_seed(case, plan.spec.seed), len(finished)]).generate_state(1)[0]
    study = optuna.create_study(
        sampler=optuna.samplers.TPESampler(seed=int(seed)),
        directions=[objective.direction for objective in plan.spec.objectives],
    )
    study.add_trials(finished)
    return [study.ask(space).params for _ in range(BATCH)]


def _distribution(name: str, entry: Any) -> Any:
    from optuna import distributions  # noqa: PLC0415

    if not isinstance(entry, Range):
        return distributions.CategoricalDistribution(entry)
    if is_whole(name, entry):
        return distributions.IntDistribution(int(entry.low), int(entry.high), log=entry.log)
    return distributions.FloatDistribution(entry.low, entry.high, log=entry.log)


def run_sweep(plan: SweepPlan, out: Path, jobs: int = 1, dask: str | None = None) -> list[Row]:
    """Execute all runs of a sweep without a cached result in `out`.

    Args:
        plan: The sweep, see `experiments.sweep.plan.load_plan`.
        out: Folder of the results, and of the trials of a tuning.
        jobs: Worker processes on this machine.
        dask: Address of the scheduler of a cluster; None for this machine.

    Returns:
        One row per run: labels, varied settings, ``left_out`` and ``failed``, and all metrics.

    Raises:
        MissingOptionalDependencyError: If Optuna or dask.distributed is required and not installed.
        GazempcError: If worker processes die (finished results are kept), or the scheduler does not respond.
    """
    cases = plan.spec.all_cases()
    if any(case.design == "optuna" for case in cases):
        check_optuna("Design optuna")
    tuned = sum(case.n or 0 for case in plan.spec.all_cases() if case.design == "optuna")
    total = len(plan.walks) * (tuned + sum(map(len, plan.points.values())))
    with Engine(out / "runs", jobs, dask, total=total) as engine:
        # All fixed points in parallel; points of a tuning follow batch by batch.
        known = [(case, i, point) for case in cases for i, point in enumerate(plan.points[case.name])]
        rows = _rows(plan, engine, known)
        for case in (case for case in cases if case.design == "optuna"):

            def score(points: Sequence[Point], case: Case = case) -> list[list[float] | None]:
                scored = _rows(plan, engine, [(case, i, point) for i, point in enumerate(points)])
                chunks = [[row for row in scored if row["point"] == i] for i in range(len(points))]
                return [page.objective_means(chunk, plan.spec.objectives) for chunk in chunks]

            points = tune(plan, case, score)
            rows += _rows(plan, engine, [(case, i, point) for i, point in enumerate(points)])
    for part in ("controller", "predictor"):
        name_parts(rows, part)
    return rows


def _rows(plan: SweepPlan, engine: Engine, points: Sequence[tuple[Case, int, Point]]) -> list[Row]:
    jobs = [resolve({**case.base, **point}) for case, _, point in points]
    results = iter(engine.run([replace(job, recording=walk.path) for job in jobs for walk in plan.walks]))
    return [page.run_row(plan, *point, walk, next(results)) for point in points for walk in plan.walks]


class SweepSettings(WorkSettings):
    """Settings of `python -m experiments.sweep`."""

    sweep: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SWEEP.yaml")] = Field(
        description=f"A sweep file, or a shipped study: {', '.join(shipped_studies())}"
    )
    recordings: tuple[str, ...] | None = Field(
        default=None, min_length=1, description="Override the file's: 'synthetic', folders, files or synthetic names"
    )
    walker: WalkerSettings = WalkerSettings()
    out: Path | None = Field(  # type: ignore[assignment]
        default=None, description="Output folder, from which a run resumes; default: out/sweep/<name>"
    )
    figures: bool = Field(default=True, description="Draw figures")


def sweep(settings: SweepSettings, command: str = "") -> int:
    """Execute all runs and write tables and figures.

    Args:
        settings: Settings of the command.
        command: Command line that reproduces it; default: this call.

    Returns:
        Exit status, see `main`.

    Raises:
        GazempcError: On invalid input, before any run; or if worker processes die (finished results are kept).
    """
    plan = load_plan(settings.sweep, settings.recordings, settings.walker.fitted)
    out = settings.out or Path("out/sweep") / plan.spec.name
    rows = run_sweep(plan, out, settings.jobs, settings.dask)
    table = page.point_table(plan, rows)
    write_csv(out / "results.csv", rows)
    write_csv(out / "table.csv", table)
    summary = _summary(plan, rows, table)
    plots = list(page.plots_of(plan, rows, table)) if table else []
    pictures = {out / f"{name}.png": plot for name, plot in plots if name and settings.figures}
    for path, plot in pictures.items():
        draw([plot], path, f"{page.recorded_or_synthetic(plan)}; means over clips, 95 % intervals over people")
    command = command or f"experiments.sweep.sweep.sweep({settings!r})"
    report = page.sweep_page(plan, summary, rows, table, [plot for _, plot in plots], pictures, command)
    print(write_results(report, out, summary))
    written = ("report.html", "results.csv", "table.csv", "summary.json", "summary.md")
    print(f"Written to {out}/: {', '.join([*written, *(path.name for path in pictures)])}")
    return exit_status(any(row["limit_violations"] for row in rows), bool(summary["failed"]))


def _summary(plan: SweepPlan, rows: list[Row], table: list[Row]) -> dict[str, Any]:
    overall = [row for row in table if row["group"] == "all"]
    objectives = plan.spec.objectives
    labels = ("case", "point", "controller", *plan.spec.varied())
    cases = plan.spec.all_cases()
    fronts = {
        case.name: page.pareto_front((r for r in overall if r["case"] == case.name), objectives) for case in cases
    }
    if len(cases) > 1:
        fronts["all cases"] = page.pareto_front(overall, objectives)
    shown = [*labels, *(o.metric for o in objectives)]
    return {
        "spec": plan.spec.model_dump(mode="json"),
        "seed": plan.spec.seed,
        "versions": versions(),
        "n_recordings": len(plan.walks),
        "n_runs": len(rows),
        "left_out": {row["recording"]: row["left_out"] for row in rows if row["left_out"]},
        "failed": [{k: row[k] for k in (*labels, "recording", "failed")} for row in rows if row["failed"]],
        "faults": all_faults(rows),
        "limit_violations": sum(row["limit_violations"] or 0 for row in rows),
        "pareto": {name: [{k: row[k] for k in shown} for row in front] for name, front in fronts.items()},
        "rows": table,
    }


main = Command("sweep", SweepSettings, __doc__, sweep).main
