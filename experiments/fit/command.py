"""Fit the default predictor, `walker`, on walking and standing people, with leave-one-person-out cross-validation.

Example: python -m experiments.fit --recordings my_walks --out out/fit
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import Field

from experiments.engine.command import Command, WorkSettings, find_recordings, in_place
from experiments.engine.engine import Cache, Engine
from experiments.engine.job import Row
from experiments.fit.examples import Examples, join
from experiments.fit.networks import ExamplesJob, NetworkJob, examples_of, model_of
from experiments.fit.spread import errors_on_left_out, fit_spread
from gazempc.errors import GazempcError
from gazempc.files.whole import write_whole
from gazempc.loop.build import FOLDS, MODEL_FILE
from gazempc.recordings.load import load
from gazempc.results.run_summary import versions
from gazempc.sim.sensor import SensorSpec, load_sensor
from predictors.walker.network import WalkerModel, save_walker_model

_FEWEST_PEOPLE = 2
_COMPUTE = ("python", "gazempc", "numpy", "scipy")


class FitSettings(WorkSettings):
    """Settings of `python -m experiments.fit`."""

    recordings: tuple[str, ...] = Field(
        min_length=1,
        description="'synthetic' (14 x 6), 'everyday', folders, files or synthetic names; of at least two people",
    )
    tracker: str | None = Field(
        default=None, description="Fit for one tracker only, a shipped sensor or .toml file; default: random trackers"
    )
    variants: int = Field(
        default=280, ge=1, le=1000, description="Random variants of each recording, in turns, pace and tracker"
    )
    steps: int = Field(default=16_000, ge=1, description="Steps of gradient descent for each of the two networks")
    seed: int = Field(default=0, ge=0, description="Seed of the random generators")
    out: Path = Field(default=Path("out/fit"), description="Output folder; an interrupted fit resumes from it")


def fit(**settings: Any) -> WalkerModel:
    """Fit and write all models.

    Args:
        **settings: Any of `FitSettings`, such as ``recordings=["my_walks"], out="out/fit"``.

    Returns:
        The model fitted on all people.

    Raises:
        GazempcError: If a recording cannot be used, or there are fewer than two people.
    """
    return _fit(FitSettings.of("fit", settings))


def _run(settings: FitSettings, _: str) -> int:
    _fit(settings)
    print(f"Written to {settings.out}/: {MODEL_FILE}, and {FOLDS}/ with a model for each person, fitted on the others")
    print(
        "Errors on people left out: "
        f"python -m experiments.forecast --recordings {' '.join(settings.recordings)} --walker.fitted {settings.out}"
    )
    return 0


def _fit(settings: FitSettings) -> WalkerModel:
    paths = find_recordings(settings.recordings)
    people = [load(path).labels.subject for path in paths]
    names = sorted(set(people))
    if len(names) < _FEWEST_PEOPLE:
        raise GazempcError(
            f"recordings of {len(names)} person ({', '.join(names)}): at least {_FEWEST_PEOPLE} are needed, "
            "because the stated uncertainty is fitted on people left out"
        )
    if any("/" in name or "\\" in name for name in names):
        raise GazempcError("people's names become file names and must not contain '/' or '\\'")
    tracker = None if settings.tracker is None else load_sensor(settings.tracker)
    print(f"{len(paths)} recordings of {len(names)} people: {', '.join(names)}")
    left_out: list[str | None] = [*names, None]
    models, scoring = _networks(settings, tracker, paths, people, left_out)
    found = errors_on_left_out(dict(zip(names, models, strict=False)), people, scoring)
    about = {
        "command": f"python -m experiments.fit --recordings {' '.join(Path(r).name for r in settings.recordings)}",
        "recordings": [Path(path).stem for path in paths],
        "settings": settings.saved("recordings", "tracker"),
        "tracker": tracker.name if tracker else "drawn at random",
        "versions": {k: v for k, v in versions().items() if k in _COMPUTE} | {k: version(k) for k in ("jax", "optax")},
    }
    folder = settings.out / FOLDS
    folder.mkdir(parents=True, exist_ok=True)
    for person, model in zip(left_out, models, strict=True):
        # The uncertainty model is fitted without the same person as the networks.
        used = [k for k, name in enumerate(people) if name != person]
        described = {**about, "people": sorted({people[k] for k in used}), "key": model.about["key"]}
        fitted = replace(model, **vars(fit_spread(join([found[k] for k in used]))), about=described)
        path = settings.out / MODEL_FILE if person is None else folder / f"{person}.npz"
        write_whole(path, partial(save_walker_model, fitted))
    for path in folder.glob("*.npz"):
        if path.stem not in names:
            path.unlink()  # from an earlier fit with other people
    return fitted


def _networks(
    settings: FitSettings, tracker: SensorSpec | None, paths: list[str], people: list[str], left_out: list[str | None]
) -> tuple[list[WalkerModel], list[Examples]]:
    folder = settings.out / "runs"
    with Engine(folder, settings.jobs, settings.dask, unit="job", total=2 * (len(paths) + len(left_out))) as engine:
        examples = [ExamplesJob(in_place(path), settings.seed, settings.variants, tracker) for path in paths]
        _check(engine.run(examples))
        # A seed independent of the training examples.
        scoring = [ExamplesJob(in_place(path), settings.seed + 1, 0, tracker) for path in paths]
        scored = [examples_of(row) for row in _check(engine.run(scoring))]
        cache = Cache(folder.resolve())
        jobs = []
        for person in left_out:
            used = [job for job, name in zip(examples, people, strict=True) if name != person]
            files = tuple(cache.path(job.key()) for job in used)
            for sees_yaws in (True, False):
                jobs.append(NetworkJob(files, settings.seed, settings.steps, sees_yaws))
        rows = _check(engine.run(jobs))
        models = [model_of(rows[k : k + 2], jobs[k].key()) for k in range(0, len(rows), 2)]
        return models, scored


def _check(rows: list[Row]) -> list[Row]:
    reasons = dict.fromkeys(row["failed"] or row["left_out"] for row in rows if row["failed"] or row["left_out"])
    if reasons:
        raise GazempcError("\n".join(reasons))
    return rows


main = Command("fit", FitSettings, __doc__, _run).main
