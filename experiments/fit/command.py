"""Fit the default predictor, `walker`, on recordings of walking people; and again leaving out each person in turn.

Example: python -m experiments.fit --recordings my_walks --out out/fit
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, fields, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tyro
from pydantic import BaseModel, ConfigDict, Field
from tqdm import tqdm

from experiments.engine.command import run_command
from experiments.engine.recordings import find_recordings
from experiments.fit.examples import Examples, fitting_examples, join, scoring_examples
from experiments.fit.networks import fit_networks
from experiments.fit.spread import calibrate, fit_spread
from gazempc.errors import GazempcError
from gazempc.recordings.load import load
from gazempc.results.report import versions
from gazempc.types import FloatArray
from predictors.walker.network import KNOTS_S, N_DOUBT, WalkerModel, WalkerModelError, load_walker_model

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

MODEL_FILE = "walker.npz"
FOLDS, NETWORKS = "left_out", "networks"
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
    print(f"{len(paths)} recordings of {len(names)} people: {', '.join(names)}")
    if any("/" in name or "\\" in name for name in names):
        raise GazempcError("people's names become file names and must not contain '/' or '\\'")
    folder = settings.out / FOLDS
    folder.mkdir(parents=True, exist_ok=True)
    make = partial(fitting_examples, seed=settings.seed, variants=settings.variants)
    fitting = _in_parallel(make, paths, settings.workers, "recording")
    scoring = [[scoring_examples(path, settings.seed + 1, bent) for bent in (False, True)] for path in paths]
    left_out: list[str | None] = [*names, None]
    (settings.out / NETWORKS).mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as parts:
        for i, part in enumerate(fitting):
            np.savez(Path(parts) / f"{i}.npz", **vars(part))
        key = _key(settings, paths, people, fitting)
        train = partial(_networks, people=people, settings=settings, parts=Path(parts), key=key)
        models = _in_parallel(train, left_out, settings.workers, "fit")

    found = _errors_on_left_out(dict(zip(names, models, strict=False)), people, scoring)
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
        _save_whole(fitted, settings.out / MODEL_FILE if person is None else folder / f"{person}.npz")
    for path in folder.glob("*.npz"):
        if path.stem not in names:
            path.unlink()  # of an earlier fit with other people
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


def _errors_on_left_out(
    left_out: Mapping[str, WalkerModel], people: Sequence[str], scoring: Sequence[Sequence[Examples | None]]
) -> list[list[_Found | None]]:
    """Errors on each recording by the model that has not seen who walks in it."""
    return [
        [None if part is None else _Found.by(left_out[person], part) for part in parts]
        for person, parts in zip(people, scoring, strict=True)
    ]


def _key(settings: FitSettings, paths: Sequence[str], people: Sequence[str], fitting: Sequence[Examples]) -> str:
    digest = hashlib.sha256(json.dumps([settings.seed, settings.networks, settings.steps, versions()]).encode())
    digest.update(Path(fit_networks.__code__.co_filename).read_bytes())
    for path, person, part in zip(paths, people, fitting, strict=True):
        digest.update(f"{Path(path).stem} {person} ".encode())
        for array in vars(part).values():
            digest.update(array.tobytes())
    return digest.hexdigest()


def _save_whole(model: WalkerModel, path: Path) -> None:
    part = path.with_suffix(f".{os.getpid()}.part.npz")
    model.save(part)
    part.replace(path)


def _networks(person: str | None, people: Sequence[str], settings: FitSettings, parts: Path, key: str) -> WalkerModel:
    # Networks whose uncertainty is not fitted yet are no models; they are kept where nobody looks for one.
    path = settings.out / NETWORKS / f"{'everybody' if person is None else f'without {person}'}.npz"
    if path.is_file():
        with contextlib.suppress(WalkerModelError):  # a broken one is made again
            model = load_walker_model(path)
            if model.about.get("key") == key:
                return model
    used = [i for i, name in enumerate(people) if name != person]
    examples = []
    for i in used:
        with np.load(parts / f"{i}.npz") as data:
            examples.append(Examples(**{name: data[name] for name in data.files}))
    weights, biases = fit_networks(join(examples), settings.seed, settings.networks, settings.steps)
    model = WalkerModel(weights, biases, np.zeros((N_DOUBT, KNOTS_S.size, 3)), {"key": key})
    _save_whole(model, path)
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
