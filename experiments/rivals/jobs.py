"""One rival, or one of ours, in one trial: a job of the engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

import gazempc as gz
from experiments.engine.job import Row, key_of, models_hash, recording_hash
from experiments.rivals.laws import RIVALS
from experiments.rivals.laws.frigate import Frigate, FrigateCalibration, MoveTime
from experiments.rivals.rival import HeadCamera, Rival, View
from experiments.rivals.simulate import Motor, driven_by, simulate
from experiments.rivals.trials import Trial, make_trial, response
from gazempc.errors import LeftOutError, SettingsError, suggest
from gazempc.results.contact import CONTACT_DEG, time_to_return
from gazempc.results.metrics import MIN_DURATION_S, gaze_error_deg
from gazempc.results.run_summary import without_nan
from gazempc.settings import DEFAULT_PREDICTOR, WalkerSettings
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import Scene

_RATE_HZ = 200.0
# Frigate accepts no calibration that takes longer.
_PATIENCE_S = 600.0


def make_rival(name: str, robot_neck: gz.NeckSpec, neck: gz.NeckSpec, camera: HeadCamera, **constants: Any) -> Rival:
    """Make a rival for a trial.

    Args:
        name: One of `RIVALS`.
        robot_neck: The simulated neck; a calibration is made on it.
        neck: The rival's model of it.
        camera: The rival's model of the camera.
        constants: Keywords of the rival.

    Returns:
        The rival.
    """
    law: Callable[..., Rival] = RIVALS[name]
    if law is Frigate:
        constants = {"move_time": calibrate(robot_neck, camera)} | constants
    return law(neck, camera, **constants)


# A trial asks again for the same neck. Safe: what goes in and comes out does not change.
@lru_cache(maxsize=16)
def calibrate(neck: gz.NeckSpec, camera: HeadCamera) -> MoveTime | None:
    """Let a camera make Frigate's thirty moves, and fit their times.

    Args:
        neck: What moves.
        camera: The camera on it; moves are in halves of its field of view.

    Returns:
        The fit; None if Frigate would not accept it.
    """
    law = FrigateCalibration(neck, camera)
    driven, now_s = driven_by(neck, law.command), 0.0
    motor = Motor(driven, np.zeros(2), lambda: now_s, seed=0)
    steps_per_answer = round(law.period_s * _RATE_HZ)
    for index in range(round(_PATIENCE_S * _RATE_HZ)):
        now_s = index / _RATE_HZ
        if index % steps_per_answer == 0:
            view = View(now_s, (), motor.reading(), lambda time_s: None, motor.idle)
            if index == 0:
                law.start(view)
            motor.ask(law.step(view))
            if law.finished:
                return law.move_time()
        motor.tick()
    return None


OURS = ("reactive", "lookahead", "mpc")
NAMES = (*RIVALS, *OURS)
ANSWERS = ("overshoot_deg", "settling_s", "settling_2p6_s", "reversals", "rest_error_deg", "recontact_s")
GAZES = ("gaze_error_rms_deg", "eye_contact_2p6", "rms_acceleration_rad_s2")
FIGURES = (*ANSWERS, *GAZES)


def check_names(what: str, names: Sequence[str], known: Sequence[str]) -> None:
    """Refuse a name that is not known.

    Raises:
        SettingsError: It names the nearest known name, and all of them.
    """
    for name in names:
        if name not in known:
            raise SettingsError(f"no {what} {name!r}; {suggest(name, known)}")


@dataclass(frozen=True)
class ModelError:
    """Errors of a law's model of robot and camera.

    Attributes:
        dead_time_scale: Believed dead time over the true one.
        servo_scale: Believed natural frequency of the servo over the true one.
        latency_error_s: Believed latency of the camera less the true one, seconds; stamps are wrong by as much.
    """

    dead_time_scale: float = 1.0
    servo_scale: float = 1.0
    latency_error_s: float = 0.0

    def neck(self, neck: gz.NeckSpec) -> gz.NeckSpec:
        """The neck as it is believed to be."""
        axes = {
            name: axis.model_copy(
                update={
                    "dead_time_s": self.dead_time_scale * axis.dead_time_s,
                    "natural_frequency_rad_s": self.servo_scale * axis.natural_frequency_rad_s,
                }
            )
            for name, axis in (("pan", neck.pan), ("tilt", neck.tilt))
        }
        return neck.model_copy(update=axes)

    def sensor(self, sensor: gz.SensorSpec) -> gz.SensorSpec:
        """The sensor with stamps that come of the believed latency."""
        offset_s = sensor.timing.stamp_offset_s - self.latency_error_s
        return sensor.model_copy(update={"timing": sensor.timing.model_copy(update={"stamp_offset_s": offset_s})})


@dataclass(frozen=True)
class RivalJob:
    """The dependencies of a run.

    Attributes:
        rival: One of `NAMES`.
        trial: One of `experiments.rivals.trials.TRIALS`.
        recording: Whom it is made on, for trials on walks.
        neck: The neck.
        sensor: The sensor, on the head.
        seed: Of all errors.
        constants: Constants of the rival other than its own, by keyword.
        error: Errors of its model.
        walker: The predictor of ours.
    """

    rival: str
    trial: str
    recording: str | None
    neck: gz.NeckSpec
    sensor: gz.SensorSpec
    seed: int = 0
    constants: dict[str, float] = field(default_factory=dict)
    error: ModelError = ModelError()
    walker: WalkerSettings = field(default_factory=WalkerSettings)

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        recording = None if self.recording is None else recording_hash(self.recording)
        return key_of(self, recording=recording, models=models_hash(self.walker.fitted))

    def run(self) -> Row:
        """Labels and `FIGURES`; None where a trial does not have a figure."""
        trial = make_trial(self.trial, self.recording)
        if float(trial.walk.times_s[-1]) < MIN_DURATION_S:
            raise LeftOutError(f"{trial.walk.name} is too short to be scored")
        log = self.log(trial)
        figures: dict[str, Any] = dict.fromkeys(ANSWERS)
        if trial.event_s is not None:
            figures |= response(log, trial.event_s, trial.joint)
        if trial.back_s is not None:
            figures["recontact_s"] = time_to_return(log, gaze_error_deg(log) <= CONTACT_DEG[0], trial.back_s)
        metrics = gz.measure(log).as_dict()
        figures |= {name: metrics[name] for name in GAZES}
        return {"subject": log.run.subject, "group": log.run.group, **without_nan(figures)}

    def log(self, trial: Trial) -> gz.Log:
        """Run it."""
        believed = self.error.neck(self.neck)
        scene = Scene(
            walk=trial.walk,
            neck=believed,
            sensor=self.error.sensor(self.sensor),
            seed=self.seed,
            start_rad=trial.start_rad,
            robot_neck=self.neck,
        )
        if self.rival in OURS:
            return replay_scene(scene, self.rival, DEFAULT_PREDICTOR, ReplaySettings(walker=self.walker)).log
        return simulate(scene, self._make, self.error.latency_error_s)

    def _make(self, neck: gz.NeckSpec, camera: HeadCamera) -> Rival:
        return make_rival(self.rival, self.neck, neck, camera, **self.constants)
