"""One controller, a rival or one of this project, in one trial, as a job."""

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
# Maximum duration of a calibration in Frigate.
_CALIBRATION_TIMEOUT_S = 600.0


def make_rival(name: str, robot_neck: gz.NeckSpec, neck: gz.NeckSpec, camera: HeadCamera, **constants: Any) -> Rival:
    """Construct a rival for a trial.

    Args:
        name: One of `RIVALS`.
        robot_neck: The simulated neck, on which a calibration runs.
        neck: The rival's model of the neck.
        camera: The rival's model of the camera.
        constants: Keyword arguments of the rival.

    Returns:
        The rival.
    """
    law: Callable[..., Rival] = RIVALS[name]
    if law is Frigate:
        constants = {"move_time": calibrate(robot_neck, camera)} | constants
    return law(neck, camera, **constants)


# Cached for repeated calls of a trial; arguments and result are immutable.
@lru_cache(maxsize=16)
def calibrate(neck: gz.NeckSpec, camera: HeadCamera) -> MoveTime | None:
    """Simulate Frigate's calibration, thirty moves, and fit their durations.

    Args:
        neck: The simulated neck.
        camera: The camera on the neck, whose field of view is the unit of the moves.

    Returns:
        The fit; None if Frigate would reject it.
    """
    law = FrigateCalibration(neck, camera)
    driven, now_s = driven_by(neck, law.command), 0.0
    motor = Motor(driven, np.zeros(2), lambda: now_s, seed=0)
    steps_per_answer = round(law.period_s * _RATE_HZ)
    for index in range(round(_CALIBRATION_TIMEOUT_S * _RATE_HZ)):
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
    """Check that all names are known.

    Raises:
        SettingsError: If one is not, with the nearest known name and all of them.
    """
    for name in names:
        if name not in known:
            raise SettingsError(f"no {what} {name!r}; {suggest(name, known)}")


@dataclass(frozen=True)
class ModelError:
    """Mismatch of a law's model of robot and camera.

    Attributes:
        dead_time_scale: Modelled over true dead time.
        servo_scale: Modelled over true natural frequency of the servo.
        latency_error_s: Modelled minus true latency of the camera, seconds; time stamps have the opposite error.
    """

    dead_time_scale: float = 1.0
    servo_scale: float = 1.0
    latency_error_s: float = 0.0

    def neck(self, neck: gz.NeckSpec) -> gz.NeckSpec:
        """The law's model of the neck."""
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
        """The sensor with time stamps from the modelled latency."""
        offset_s = sensor.timing.stamp_offset_s - self.latency_error_s
        return sensor.model_copy(update={"timing": sensor.timing.model_copy(update={"stamp_offset_s": offset_s})})


@dataclass(frozen=True)
class RivalJob:
    """Inputs of a run.

    Attributes:
        rival: One of `NAMES`.
        trial: One of `experiments.rivals.trials.TRIALS`.
        recording: Recording of the person, for trials on recordings; otherwise None.
        neck: The neck.
        sensor: The sensor, on the head.
        seed: Seed of all errors.
        constants: Constants of the rival that override its defaults, by keyword.
        error: Model mismatch.
        walker: The predictor of this project's controllers.
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
        """Labels and `FIGURES`; None if the trial does not define one."""
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
        """Execute the run."""
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
