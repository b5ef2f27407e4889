"""Do all runs of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from experiments.engine.engine import Engine
from experiments.engine.job import Row
from experiments.engine.own_parts import name_parts
from experiments.sweep.designs import Point
from experiments.sweep.plan import SweepPlan
from experiments.sweep.spec import Case
from experiments.sweep.tables import objective_means, run_row
from experiments.sweep.tuning import check_installed, tune
from experiments.sweep.variants import resolve


def run_sweep(plan: SweepPlan, out: Path, jobs: int = 1, dask: str | None = None) -> tuple[list[Row], float]:
    """Do all runs of a sweep; those that have a result in `out` are not done again.

    Args:
        plan: The sweep, see `experiments.sweep.plan.load_plan`.
        out: Folder for the results, and for the trials of a tuning.
        jobs: Worker processes on this machine.
        dask: Address of the scheduler of a cluster that does the runs instead.

    Returns:
        A row for each run (labels, the settings that vary, ``left_out`` and ``failed``, and all metrics), and the
        simulated time of the runs that were not there before, seconds.

    Raises:
        MissingOptionalDependencyError: If Optuna or dask.distributed is needed and not installed.
        GazempcError: If worker processes die, with what was done kept; or if no scheduler answers.
    """
    cases = plan.spec.all_cases()
    if any(case.design == "optuna" for case in cases):
        check_installed()
    with Engine(out / "runs", jobs, dask, total=_count(plan)) as engine:
        # All points that are known go to the workers at once; those of a tuning follow batch by batch.
        known = [(case, i, point) for case in cases for i, point in enumerate(plan.points[case.name])]
        rows = _rows(plan, engine, known)
        for case in (case for case in cases if case.design == "optuna"):

            def score(points: Sequence[Point], case: Case = case) -> list[list[float] | None]:
                scored = _rows(plan, engine, [(case, i, point) for i, point in enumerate(points)])
                chunks = [[row for row in scored if row["point"] == i] for i in range(len(points))]
                return [objective_means(chunk, plan.spec.objectives) for chunk in chunks]

            points = tune(plan, case, out / "optuna.log", score)
            rows += _rows(plan, engine, [(case, i, point) for i, point in enumerate(points)])
    for part in ("controller", "predictor"):
        name_parts(rows, part)
    return rows, sum(row.get("simulated_s", 0.0) for row in engine.fresh)


def _count(plan: SweepPlan) -> int:
    tuned = sum(case.n or 0 for case in plan.spec.all_cases() if case.design == "optuna")
    return len(plan.walks) * (tuned + sum(map(len, plan.points.values())))


def _rows(plan: SweepPlan, engine: Engine, points: Sequence[tuple[Case, int, Point]]) -> list[Row]:
    variants = [resolve({**case.base, **point}) for case, _, point in points]
    results = iter(engine.run([variant.on(walk.path) for variant in variants for walk in plan.walks]))
    return [run_row(plan, *point, walk, next(results)) for point in points for walk in plan.walks]
