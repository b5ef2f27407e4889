"""One replay as a job; what many replays share is made once in each worker."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from experiments.engine.job import Row
from experiments.engine.keys import key_of, models_hash, recording_hash
from gazempc.controllers.controller import Controller
from gazempc.errors import LeftOutError
from gazempc.neck.spec import NeckSpec
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.metrics import measure, measure_compute
from gazempc.settings import ControllerName, LookAheadSettings, MpcSettings, RunSettings
from gazempc.sim.replay import make_controller, replay
from gazempc.sim.sensor import SensorSpec, default_sensor, load_sensor

# These say where a run is written, or are resolved into specifications and hashes; none changes its metrics.
_NOT_HASHED = {"replay", "list", "controllers", "out", "figures", "config", "neck", "sensor", "walker"}
# Sensors that a recording may call for if none is named.
_DEFAULT_SENSORS = ("reference", "recorded")


@dataclass(frozen=True)
class ReplayJob:
    """All that a replay depends on.

    Attributes:
        recording: Synthetic name or path.
        controller: Controller; ``perfect`` is the MPC with the true future.
        settings: Parameters of predictor, controller and loop, the placement and the seed.
        model_neck: The neck as controller and smoother know it.
        robot_neck: The neck that is simulated.
        sensors: Sensor by the name of the file it is made from: the one that was chosen, or each that a recording may
            call for.
    """

    recording: str
    controller: ControllerName
    settings: RunSettings
    model_neck: NeckSpec
    robot_neck: NeckSpec
    sensors: Mapping[str, SensorSpec]

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        content = {
            "recording": recording_hash(self.recording),
            "controller": self.controller,
            "settings": self.settings.model_dump(mode="json", exclude=_NOT_HASHED),
            "models": models_hash(self.settings.walker.fitted),
            "necks": [neck.model_dump(mode="json") for neck in (self.model_neck, self.robot_neck)],
            "sensors": {name: sensor.model_dump(mode="json") for name, sensor in self.sensors.items()},
        }
        return key_of(content, __name__)

    def run(self) -> Row:
        """Replay and measure.

        Returns:
            Labels of the recording, then `metrics_of`; or ``left_out`` if it cannot be placed or scored.
        """
        settings = self.settings
        recording = load_once(self.recording, settings.reading)
        labels = {"kind": recording.kind, "subject": recording.labels.subject, "group": recording.labels.group}
        placement = settings.placement or ("recorded" if recording.has_robot else "side")
        sensor = self.sensors[settings.sensor or default_sensor(recording)]
        controller = _controller(self.controller, self.model_neck, settings.lookahead, settings.mpc)
        try:
            placed = place(recording, placement, settings.distance_m, settings.height_m)
            done = replay(placed, self.model_neck, sensor, self.controller, settings, controller, self.robot_neck)
        except LeftOutError as error:
            return labels | {"left_out": str(error)}
        return labels | metrics_of(*done)


def sensors_by_name(chosen: str | None) -> dict[str, SensorSpec]:
    """The chosen sensor, or all that a recording may call for.

    Args:
        chosen: Shipped sensor or .toml file; None for the one that fits each recording.

    Returns:
        Sensor by name.

    Raises:
        SettingsError: If there is no such sensor.
    """
    return {name: load_sensor(name) for name in ((chosen,) if chosen else _DEFAULT_SENSORS)}


def metrics_of(log: Log, times: ComputeTimes) -> dict[str, Any]:
    """All metrics of a run.

    Args:
        log: What happened.
        times: How long the computer took.

    Returns:
        ``simulated_s``, then every metric by name; NaN is None.
    """
    metrics = measure(log).as_dict() | measure_compute(times, log.neck().control_period_s).as_dict()
    known = {name: None if _is_nan(value) else value for name, value in metrics.items()}
    return {"simulated_s": float(log.time_s[-1] - log.time_s[0])} | known


def load_once(recording: str, reading: ReadOptions | None = None) -> Recording:
    """A recording, read once for the jobs that follow each other in a worker, unless its file changes."""
    return _load_once(recording, reading, tuple(recording_hash(recording)))


@lru_cache(maxsize=8)
def _load_once(recording: str, reading: ReadOptions | None, _: tuple[str, ...]) -> Recording:
    return load(recording, reading)


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


@lru_cache(maxsize=16)
def _controller(name: ControllerName, neck: NeckSpec, lookahead: LookAheadSettings, mpc: MpcSettings) -> Controller:
    return make_controller(name, neck, RunSettings(lookahead=lookahead, mpc=mpc))
