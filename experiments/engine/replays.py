"""One replay as a job; recordings are read once in each worker."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from experiments.engine.job import Row, file_hash, key_of, models_hash, parts_hash, recording_hash
from gazempc.errors import LeftOutError
from gazempc.neck.spec import NeckSpec
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording
from gazempc.results.metrics import measure
from gazempc.results.run_summary import measure_compute, without_nan
from gazempc.sim.replay import Replayed, ReplaySettings, replay_scene
from gazempc.sim.scene import make_scene
from gazempc.sim.sensor import SensorSpec, default_sensor


@dataclass(frozen=True)
class ReplayJob:
    """Inputs of a replay.

    Attributes:
        recording: Synthetic name or path.
        controller: A shipped name or ``module:Class``; ``mpc+perfect`` is the MPC with the true future.
        settings: The predictor, parameters of predictor, controller and loop, the robot's place and the seed.
        neck: Model of the neck for controller and smoother.
        robot_neck: The simulated neck.
        sensors: Sensor by file name: the chosen one, or all defaults.
    """

    recording: str
    controller: str
    settings: ReplaySettings
    neck: NeckSpec
    robot_neck: NeckSpec
    sensors: Mapping[str, SensorSpec]

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        mapping, fitted = self.settings.reading.mapping, self.settings.walker.fitted
        return key_of(
            self,
            recording=recording_hash(self.recording),
            mapping=file_hash(mapping) if mapping else "",
            models=models_hash(fitted),
            parts=parts_hash(self.controller, self.settings.predictor),
        )

    def run(self) -> Row:
        """Replay and compute the metrics.

        Returns:
            Labels of the recording, names of the parts, `metrics_of`, and ``faults`` after caught exceptions; only
            labels and ``left_out`` if the run cannot be scored.
        """
        recording = load_once(self.recording, self.settings.reading)
        sensor = self.sensors[self.settings.sensor or default_sensor(recording)]
        labels = {
            "data_kind": recording.kind,
            "subject": recording.labels.subject,
            "group": recording.labels.group,
            "kind": recording.labels.activity,
            "sensor": sensor.name,
            "notes": "; ".join(recording.notes),
        }
        try:
            scene = replace(make_scene(recording, self.settings, self.neck, sensor), robot_neck=self.robot_neck)
            done = replay_scene(scene, self.controller, self.settings.predictor, self.settings)
        except LeftOutError as error:
            return labels | {"left_out": str(error)}
        names = {"controller_name": done.log.run.controller, "predictor_name": done.log.run.predictor}
        survived = {"faults": [vars(fault) for fault in done.log.faults]} if done.log.faults else {}
        return labels | names | metrics_of(done) | survived


def metrics_of(done: Replayed) -> Row:
    """All metrics of a replay.

    Args:
        done: Log and computing times.

    Returns:
        ``simulated_s``, then all metrics by name; None for NaN.
    """
    log = done.log
    metrics = vars(measure(log)) | vars(measure_compute(done.times, log.neck.control_period_s))
    return {"simulated_s": float(log.time_s[-1] - log.time_s[0]), **without_nan(metrics)}


def all_faults(rows: Iterable[Row]) -> list[Row]:
    """Caught exceptions of runs.

    Args:
        rows: Runs, with ``controller`` and ``predictor`` if these vary.

    Returns:
        One entry per controller, predictor and ``event``: number of ``runs``, total ``count``, and the first ``error``
        with its ``traceback``.
    """
    merged: dict[tuple[str, ...], Row] = {}
    for row in rows:
        parts = {name: row[name] for name in ("controller", "predictor") if name in row}
        for fault in row.get("faults", ()):
            key = (*parts.values(), fault["event"])
            known = merged.get(key, parts | fault | {"runs": 0, "count": 0})
            merged[key] = known | {"runs": known["runs"] + 1, "count": known["count"] + fault["count"]}
    return list(merged.values())


def load_once(recording: str, reading: ReadOptions | None = None) -> Recording:
    """Load a recording, cached for successive jobs of a worker until its file changes."""
    return _load_once(recording, reading, tuple(recording_hash(recording)))


@lru_cache(maxsize=8)
def _load_once(recording: str, reading: ReadOptions | None, _: tuple[str, ...]) -> Recording:
    return load(recording, reading)
