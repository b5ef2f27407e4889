"""One replay as a job: what it is made of, its name, and how a worker does it."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gazempc.config import ControllerName, PlacementName, PredictorName, RunSettings
from gazempc.controllers import Controller
from gazempc.errors import GazempcError, PlacementError
from gazempc.metrics import measure, measure_compute
from gazempc.neck import NeckSpec, load_neck
from gazempc.placement import place
from gazempc.recording import Recording, load
from gazempc.replay import make_controller, replay
from gazempc.sensor import SensorSpec, default_sensor, load_sensor


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

    def key(self) -> str:
        """Name of the run: a hash of the job, of the files it reads and of the package's version."""
        content = {**asdict(self), "version": version("gazempc")}
        for name in (self.recording, self.neck, self.sensor or ""):
            path = Path(name)
            if path.is_file():
                content[f"bytes of {name}"] = hashlib.sha256(path.read_bytes()).hexdigest()
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:20]

    def settings(self) -> RunSettings:
        """The job as the settings of a run."""
        predictor = "constant_velocity" if self.predictor == "perfect" else self.predictor
        return RunSettings(predictor=predictor, seed=self.seed)


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
        "subject": None,
        "group": None,
        "controller": job.controller,
        "predictor": job.predictor,
        "neck": job.neck,
        "seed": job.seed,
        "left_out": None,
        "failed": None,
    }
    try:
        recording = _recording(job.recording)
        row |= {"subject": recording.labels.subject, "group": recording.labels.group}
        placement = job.placement or ("recorded" if recording.has_robot else "side")
        placed = place(recording, placement, job.distance_m, job.height_m)
        neck, sensor = _neck(job.neck), _sensor(job.sensor or default_sensor(recording))
        log, times = replay(placed, neck, sensor, job.controller, job.settings(), _controller(job.controller, job.neck))
    except PlacementError as error:
        return row | {"left_out": str(error)}
    except (GazempcError, ArithmeticError, ValueError, RuntimeError) as error:
        return row | {"failed": f"{type(error).__name__}: {error}"}
    figures = measure(log).as_dict() | measure_compute(times, neck.control_period_s).as_dict()
    simulated = {"simulated_s": float(log.time_s[-1] - log.time_s[0])}
    return row | simulated | {k: None if _is_nan(v) else v for k, v in figures.items()}


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
