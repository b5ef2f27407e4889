"""Fit the default predictor, `walker`, on recordings of walking people; and again leaving out each person in turn.

Example: python -m experiments.fit --recordings my_walks --out out/fit
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, fields, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tyro
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field
from tqdm import tqdm

from experiments.command import run_command
from experiments.fit_networks import fit_networks
from experiments.fit_spread import calibrate, fit_spread
from experiments.recordings import find_recordings
from experiments.walk_examples import Examples, fitting_examples, join, scoring_examples
from gazempc.errors import GazempcError
from gazempc.recording import load
from gazempc.report import versions
from predictors.walker_model import KNOTS_S, N_DOUBT, WalkerModel, load_walker_model

FloatArray = NDArray[np.float64]
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

MODEL_FILE = "walker.npz"
FOLDS = "left_out"
_FEWEST_PEOPLE = 2
_COMPUTE = ("python", "gazempc", "numpy", "scipy")


class FitSettings(BaseModel):
    """Settings of `python -m experiments.fit`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    recordings: tuple[str, ...] = Field(
        min_length=1, description="'synthetic' (14 x 6), folders, files or synthetic names; of two people at least"
    )
    variants: int = Field(
        default=40, ge=1, le=1000, description="Variants of each recording: bent, mirrored, noisy ..."
    )
    networks: int = Field(default=4, ge=1, le=20, description="Networks in the ensemble")
    steps: int = Field(default=6000, ge=1, description="Steps of gradient descent for each network")
    seed: int = Field(default=0, ge=0, description="Seed of all that is random")
    workers: int = Field(default=os.cpu_count() or 1, ge=1, description="Parallel processes")
    out: Path = Field(default=Path("out/fit"), description="Where to write; finished parts in it are used again")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 2 on bad input, 130 if interrupted.
    """
    settings = tyro.cli(FitSettings, args=arguments, prog="python -m experiments.fit", description=__doc__)
    return run_command("fit", lambda: _run(settings))


def _run(settings: FitSettings) -> int:
    fit(settings)
    print(f"Written to {settings.out}/: {MODEL_FILE}, and {FOLDS}/ with a model for each person that has not seen them")
    print(
        "Errors on people left out: "
        f"python -m experiments.forecast --recordings {' '.join(settings.recordings)} --walker.fitted {settings.out}"
    )
    return 0


def fit(settings: FitSettings) -> WalkerModel:
    """Fit and write all models.

    Args:
        settings: What to fit on, and how.

    Returns:
        The model fitted on everybody.

    Raises:
        GazempcError: If a recording cannot be used, or there are fewer than two people.
    """
    paths = find_recordings(settings.recordings)
    people = [load(path).labels.subject for path in paths]
    names = sorted(set(people))
    if len(names) < _FEWEST_PEOPLE:
        raise GazempcError(
            f"recordings of {len(names)} person ({', '.join(names)}): at least {_FEWEST_PEOPLE} are needed, "
            "because the stated uncertainty is fitted on people left out"
        )
    folder = settings.out / FOLDS
    folder.mkdir(parents=True, exist_ok=True)
    make = partial(fitting_examples, seed=settings.seed, variants=settings.variants)
    fitting = _in_parallel(make, paths, settings.workers, "recording")
    scoring = [[scoring_examples(path, settings.seed + 1, bent) for bent in (False, True)] for path in paths]
    left_out: list[str | None] = [*names, None]
    parts = settings.out / "parts"
    parts.mkdir(exist_ok=True)
    for i, part in enumerate(fitting):
        np.savez(parts / f"{i}.npz", **vars(part))
    train = partial(_networks, people=people, settings=settings, key=_key(settings, paths, fitting))
    models = _in_parallel(train, left_out, settings.workers, "fit")
    for path in parts.iterdir():
        path.unlink()
    parts.rmdir()

    found = [
        [None if part is None else _Found.by(models[names.index(who)], part) for part in parts_of]
        for who, parts_of in zip(people, scoring, strict=True)
    ]
    about = {
        "command": f"python -m experiments.fit --recordings {' '.join(Path(r).name for r in settings.recordings)}",
        "recordings": [Path(path).stem for path in paths],
        "settings": settings.model_dump(mode="json", exclude={"out", "recordings", "workers"}),
        "versions": {k: v for k, v in versions().items() if k in _COMPUTE} | {k: version(k) for k in ("jax", "optax")},
    }
    for person, model in zip(left_out, models, strict=True):
        # Whoever is left out of the networks is left out of the uncertainty as well.
        used = [k for k, name in enumerate(people) if name != person]
        plain = _Found.join([found[k][0] for k in used])
        everything = _Found.join([f for k in used for f in found[k]])
        log_spread = fit_spread(everything.doubt, everything.error_m, everything.weight)
        log_spread = calibrate(log_spread, plain.doubt, plain.error_m)
        fitted = replace(
            model,
            log_spread=log_spread,
            about={**about, "people": sorted({people[k] for k in used}), "key": model.about["key"]},
        )
        fitted.save(settings.out / MODEL_FILE if person is None else folder / f"{person}.npz")
    return fitted


@dataclass(frozen=True)
class _Found:
    """How far forecasts erred."""

    doubt: FloatArray
    error_m: FloatArray
    weight: FloatArray

    @classmethod
    def by(cls, model: WalkerModel, part: Examples) -> _Found:
        departure, doubt = model.answer(part.network.astype(np.float64), part.spread.astype(np.float64))
        return cls(doubt, departure - part.departure_m, part.weight.astype(np.float64))

    @classmethod
    def join(cls, parts: Sequence[_Found | None]) -> _Found:
        known = [p for p in parts if p is not None]
        return cls(*(np.concatenate([getattr(p, f.name) for p in known]) for f in fields(cls)))


def _key(settings: FitSettings, paths: Sequence[str], fitting: Sequence[Examples]) -> str:
    digest = hashlib.sha256(json.dumps([settings.seed, settings.networks, settings.steps, versions()]).encode())
    for path, part in zip(paths, fitting, strict=True):
        digest.update(Path(path).stem.encode())
        for array in vars(part).values():
            digest.update(array.tobytes())
    return digest.hexdigest()


def _networks(person: str | None, people: Sequence[str], settings: FitSettings, key: str) -> WalkerModel:
    path = settings.out / MODEL_FILE if person is None else settings.out / FOLDS / f"{person}.npz"
    if path.is_file():
        # load_walker_model keeps what it read; here the file may have changed.
        model = load_walker_model.__wrapped__(path)
        if model.about.get("key") == key:
            return model
    used = [i for i, name in enumerate(people) if name != person]
    parts = []
    for i in used:
        with np.load(settings.out / "parts" / f"{i}.npz") as data:
            parts.append(Examples(**{name: data[name] for name in data.files}))
    weights, biases = fit_networks(join(parts), settings.seed, settings.networks, settings.steps)
    model = WalkerModel(weights, biases, np.zeros((N_DOUBT, KNOTS_S.size, 3)), {"key": key})
    model.save(path)
    return model


def _in_parallel(work: Callable[[_Item], _Result], items: Sequence[_Item], workers: int, unit: str) -> list[_Result]:
    # One numerical thread a process: the matrices are small, and the processes are the parallelism.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
    pool = ProcessPoolExecutor(max_workers=workers, mp_context=multiprocessing.get_context("spawn"))
    results: dict[int, Any] = {}
    try:
        waiting = {pool.submit(work, item): i for i, item in enumerate(items)}
        for done in tqdm(as_completed(waiting), total=len(items), unit=unit, file=sys.stderr, mininterval=1.0):
            results[waiting[done]] = done.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    return [results[i] for i in range(len(items))]


if __name__ == "__main__":
    sys.exit(main())
