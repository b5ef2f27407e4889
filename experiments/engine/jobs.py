"""One replay as a job: what it is made of, its name, and how a worker does it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gazempc
import predictors
from gazempc.controllers.controller import Controller
from gazempc.errors import GazempcError, LeftOutError
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.recording import Recording
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.metrics import measure, measure_compute
from gazempc.settings import ControllerName, PlacementName, PredictorName, RunSettings, WalkerSettings
from gazempc.sim.replay import make_controller, replay
from gazempc.sim.sensor import SensorSpec, default_sensor, load_sensor


@dataclass(frozen=True)
class Job:
    """All that a run depends on.

    Attributes:
        recording: Synthetic name or path.
        controller: Controller; ``perfect`` is the MPC with the true future.
        predictor: Predictor.
        neck: Shipped neck or path.
        sensor: Shipped sensor or path; None for the one that fits the recording.
        placement: Where the robot stands; None for what fits the recording.
        distance_m: Distance for placement ``side``, metres.
        height_m: Height for placement ``side``, metres.
        seed: Seed of the sensor's noise.
        fitted: Model of the predictor ``walker`` or folder of such models; None for the shipped one.
        start_offset_deg: Where the pan starts, beside the person, degrees.
    """

    recording: str
    controller: ControllerName
    predictor: PredictorName
    neck: str
    sensor: str | None
    placement: PlacementName | None
    distance_m: float
    height_m: float
    seed: int
    fitted: str | None = None
    start_offset_deg: float = 0.0

    def key(self) -> str:
        """Name of the run: a hash of the job, of the files it reads and of the program."""
        content = {**asdict(self), "program": program_hash()}
        index = str(Path(self.recording).with_name("index.csv"))  # gives subject and group
        if self.fitted is not None:
            content["bytes of fitted"] = fitted_hash(Path(self.fitted))
        for name in (self.recording, index, self.neck, self.sensor or ""):
            path = Path(name)
            if path.is_file():
                content[f"bytes of {name}"] = hashlib.sha256(path.read_bytes()).hexdigest()
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:20]

    def settings(self) -> RunSettings:
        """The job as the settings of a run."""
        predictor = "constant_velocity" if self.predictor == "perfect" else self.predictor
        fitted = None if self.fitted is None else Path(self.fitted)
        return RunSettings(
            predictor=predictor,
            seed=self.seed,
            walker=WalkerSettings(fitted=fitted),
            start_offset_deg=self.start_offset_deg,
        )


@lru_cache(maxsize=4)
def fitted_hash(fitted: Path) -> str:
    """Hash of fitted models.

    Args:
        fitted: A model, or a folder with models in it.

    Returns:
        The hash; of nothing, if there is none.
    """
    digest = hashlib.sha256()
    for path in [fitted] if fitted.is_file() else sorted(fitted.rglob("*.npz")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


@lru_cache(maxsize=1)
def program_hash() -> str:
    """Hash of all that computes a run: the sources of this package's parts, and the versions of its libraries."""
    digest = hashlib.sha256()
    for package in (predictors, gazempc):
        root = Path(package.__file__ or "").parent
        for path in sorted(p for p in root.rglob("*") if p.suffix in {".py", ".toml", ".npz"}):
            digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    for library in ("casadi", "daqp", "numpy", "scipy", "filterpy", "ruckig"):
        digest.update(f"{library} {version(library)}".encode())
    return digest.hexdigest()[:20]


def execute(job: Job) -> dict[str, Any]:
    """Do a job; never raises for what a user can cause.

    Args:
        job: The job.

    Returns:
        A row: the job's labels, then either all figures, or ``left_out`` (the robot cannot be placed beside this walk)
        or ``failed`` with the reason. NaN is None.
    """
    row: dict[str, Any] = {
        "recording": Path(job.recording).stem,
        "source": job.recording,
        "kind": None,
        "subject": None,
        "group": None,
        "controller": job.controller,
        "predictor": job.predictor,
        "neck": job.neck,
        "seed": job.seed,
        "left_out": None,
        "failed": None,
    }

    def work() -> dict[str, Any]:
        recording = _recording(job.recording)
        row.update(kind=recording.kind, subject=recording.labels.subject, group=recording.labels.group)
        neck, sensor = _neck(job.neck), _sensor(job.sensor or default_sensor(recording))
        placement = job.placement or ("recorded" if recording.has_robot else "side")
        placed = place(recording, placement, job.distance_m, job.height_m)
        controller = _controller(job.controller, job.neck)
        return figures_of(*replay(placed, neck, sensor, job.controller, job.settings(), controller))

    return row | attempt(work)


def attempt(work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Do a run; never raises for what a user can cause.

    Args:
        work: Gives the figures of the run.

    Returns:
        The figures, or ``left_out`` (the experiment cannot be made with this walk) or ``failed`` with the reason.
    """
    try:
        return work()
    except LeftOutError as error:
        return {"left_out": str(error)}
    except (GazempcError, ArithmeticError, ValueError, RuntimeError) as error:
        return {"failed": f"{type(error).__name__}: {error}"}


def figures_of(log: Log, times: ComputeTimes) -> dict[str, Any]:
    """All figures of a run.

    Args:
        log: What happened.
        times: How long the computer took.

    Returns:
        ``simulated_s``, then every metric by name; NaN is None.
    """
    figures = measure(log).as_dict() | measure_compute(times, log.neck().control_period_s).as_dict()
    simulated_s = float(log.time_s[-1] - log.time_s[0])
    return {"simulated_s": simulated_s} | {k: None if _is_nan(v) else v for k, v in figures.items()}


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


# What many jobs share is made once in each worker; above all the MPC's solver.
@lru_cache(maxsize=8)
def _recording(name: str) -> Recording:
    return load(name)


@lru_cache(maxsize=32)
def _neck(name: str) -> NeckSpec:
    return load_neck(name)


@lru_cache(maxsize=32)
def _sensor(name: str) -> SensorSpec:
    return load_sensor(name)


@lru_cache(maxsize=32)
def _controller(name: ControllerName, neck: str) -> Controller:
    return make_controller(name, _neck(neck), RunSettings())
