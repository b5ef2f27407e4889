"""What a wrong model costs: dead time, servo and latency believed wrongly, one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from experiments.engine.job import Row
from experiments.rivals.jobs import NAMES, OURS, ModelError, RivalJob
from experiments.rivals.plan import at_their_best, summarise

# Those that know a model of the neck, or the latency of the camera.
WITH_MODEL = ("smith", "smith_feedforward", *OURS)
WITHOUT_MODEL = tuple(name for name in NAMES if name not in WITH_MODEL)
DEAD_TIME, SERVO, LATENCY = "dead time", "servo", "latency"
LABELS = {
    DEAD_TIME: "believed dead time, % off the true one",
    SERVO: "believed servo frequency, % off the true one",
    LATENCY: "believed latency of the camera less the true one (ms)",
}
_ERRORS: dict[str, dict[float, ModelError]] = {
    DEAD_TIME: {by: ModelError(dead_time_scale=1.0 + by / 100.0) for by in (-30.0, -15.0, 0.0, 15.0, 30.0)},
    SERVO: {by: ModelError(servo_scale=1.0 + by / 100.0) for by in (-20.0, 0.0, 20.0)},
    LATENCY: {by: ModelError(latency_error_s=by / 1000.0) for by in (-50.0, 0.0, 50.0)},
}
ERRORS = tuple(dict.fromkeys(error for errors in _ERRORS.values() for error in errors.values()))


def wrong_jobs(jobs: Sequence[RivalJob], results: Sequence[Row]) -> list[RivalJob]:
    """The same jobs with each error, of those that have a model.

    A rival with free constants has those that are best where nothing is believed wrongly.

    Args:
        jobs: Jobs without an error.
        results: Their results, as of `experiments.rivals.plan.labelled`.

    Returns:
        The jobs.
    """
    known = [run for run in results if not run["failed"] and not run["left_out"]]
    chosen = {(run["rival"], run["constants"]) for run in at_their_best(known)}
    return [
        replace(job, error=error)
        for error in ERRORS
        for job, run in zip(jobs, results, strict=True)
        if job.rival in WITH_MODEL and error != ModelError() and (run["rival"], run["constants"]) in chosen
    ]


def by_error(runs: Sequence[Row]) -> dict[str, list[dict[str, Any]]]:
    """Rows of each error.

    Args:
        runs: Runs with figures, of one neck and sensor.

    Returns:
        By what is believed wrongly: rows as of `experiments.rivals.plan.summarise` with ``error`` (its name) and
        ``by`` (percent, or milliseconds).
    """
    right = at_their_best([run for run in runs if run["error"] == ModelError()])
    chosen = {(run["rival"], run["constants"]) for run in right}
    runs = [run for run in runs if (run["rival"], run["constants"]) in chosen]
    return {
        name: [
            {**row, "error": name, "by": by}
            for by, error in errors.items()
            for row in summarise([run for run in runs if run["error"] == error])
        ]
        for name, errors in _ERRORS.items()
    }
