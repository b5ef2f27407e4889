"""Replay a recording to a simulated neck, in simulated time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from gazempc.controllers.controller import Controller
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.reactive import Reactive
from gazempc.errors import LeftOutError, SettingsError
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.smoother import Smoother
from gazempc.neck.kinematics import look_at
from gazempc.neck.spec import NeckSpec
from gazempc.recordings.recording import Recording
from gazempc.recordings.truth import TrueHead
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.metrics import MIN_DURATION_S
from gazempc.settings import ControllerName, GazeSettings, PredictorName, PredictorSettings, RunSettings
from gazempc.sim.sensor import SensorSpec, observe
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import FloatArray
from predictors import (
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    HeadPose,
    InteractingModels,
    LastPosition,
    ParticleFilter,
    PelvisPursuit,
    Perfect,
    Predictor,
    Walker,
)
from predictors.walker.network import WalkerModel, WalkerModelError, load_walker_model, model_file, shipped_walker_model


def make_predictor(
    name: PredictorName, settings: PredictorSettings, true_head: TrueHead | None, person: str = ""
) -> Predictor:
    """Make a predictor.

    Args:
        name: Which one.
        settings: Its parameters are in here.
        true_head: The future, for ``perfect``; None where nobody knows it.
        person: Who walks; with `settings.walker.fitted` a folder, the model is one that has not seen them.

    Returns:
        The predictor.

    Raises:
        SettingsError: If there is no fitted model where the settings say, or no future.
    """
    if name == "last_position":
        return LastPosition(settings.constant_velocity.position_noise_m)
    if name == "walker":
        return Walker(walker_model(settings.walker.fitted, person), **settings.constant_velocity.model_dump())
    if name == "perfect":
        if true_head is None:
            raise SettingsError("predictor perfect: nobody knows the true future here")
        return Perfect(true_head)
    classes: dict[str, Callable[..., Predictor]] = {
        "constant_velocity": ConstantVelocity,
        "constant_acceleration": ConstantAcceleration,
        "coordinated_turn": CoordinatedTurn,
        "interacting_models": InteractingModels,
        "particle": ParticleFilter,
        "head_pose": HeadPose,
        "pelvis_pursuit": PelvisPursuit,
    }
    own: BaseModel = getattr(settings, name)
    return classes[name](**own.model_dump())


def walker_model(fitted: Path | None, person: str) -> WalkerModel:
    """The model of the predictor `walker` for a person.

    Args:
        fitted: A model or a folder of models; None for the shipped one.
        person: Who walks; of a folder, the model that has not seen them.

    Returns:
        The model.

    Raises:
        SettingsError: If there is none.
    """
    try:
        return shipped_walker_model() if fitted is None else load_walker_model(model_file(fitted, person))
    except WalkerModelError as error:
        raise SettingsError(f"walker.fitted: {error}") from None


def make_controller(name: ControllerName, neck: NeckSpec, settings: GazeSettings) -> Controller:
    """Make a controller.

    Args:
        name: Which one; ``perfect`` is the MPC.
        neck: The neck.
        settings: Its parameters are in here.

    Returns:
        The controller.
    """
    if name == "reactive":
        return Reactive(neck)
    if name == "lookahead":
        return LookAhead(neck, **settings.lookahead.model_dump())
    return Mpc(neck, **settings.mpc.model_dump())


def replay(
    placed: Recording,
    neck: NeckSpec,
    sensor: SensorSpec,
    controller_name: ControllerName,
    settings: RunSettings,
    controller: Controller | None = None,
    robot_neck: NeckSpec | None = None,
    on_tick: Callable[[float], None] | None = None,
) -> tuple[Log, ComputeTimes]:
    """Replay a recording to one controller on a simulated neck.

    The neck starts at rest, looking at the first observed head (or `start_offset_deg` beside it). The same
    arguments give the same log to the last bit.

    Args:
        placed: The recording in the base frame, see `gazempc.recordings.placement.place`.
        neck: The neck as controller and smoother know it.
        sensor: The sensor.
        controller_name: Which controller; ``perfect`` is the MPC with the predictor ``perfect``.
        settings: Parameters of predictor, controller and loop, and the seed.
        controller: An instance to use again, made by `make_controller` for the same neck and settings.
        on_tick: Told at each tick which share of the recording is done, 0 to 1.
        robot_neck: The neck that is simulated, where it differs from what is known of it; it must have the same rates.

    Returns:
        The log, and how long the computer took.

    Raises:
        LeftOutError: If the recording is too short to be scored.
    """
    if placed.times_s[-1] < MIN_DURATION_S:
        raise LeftOutError(
            f"{placed.name}: {placed.times_s[-1]:.2f} s is too short to be scored: "
            f"at least {MIN_DURATION_S} s are needed"
        )
    true_head = TrueHead(placed)
    predictor_name: PredictorName = "perfect" if controller_name == "perfect" else settings.predictor
    predictor = make_predictor(predictor_name, settings, true_head, placed.labels.subject)
    if controller is None:
        controller = make_controller(controller_name, neck, settings)
    controller.reset()
    sightings = deque(observe(placed, sensor, settings.seed))
    start = look_at(neck.geometry, sightings[0].observation.head_position_base_m).angles_rad
    start[0] += np.deg2rad(settings.start_offset_deg)
    smoother = Smoother(neck, start)

    now_s = 0.0
    robot = SimulatedNeck(robot_neck or neck, smoother.command.position_rad, lambda: now_s, settings.seed)
    true_joints = []
    recorder = LoopRecorder(neck.control_period_s)
    loop = GazeLoop(neck, predictor, controller, smoother, robot, recorder, settings.loop)
    robot.connect()
    end_s = float(placed.times_s[-1])
    for index in range(int(end_s * neck.servo_rate_hz + 1e-6) + 1):
        now_s = index * neck.servo_period_s
        arrived = []
        while sightings and sightings[0].arrival_s <= now_s + 1e-9:
            arrived.append(sightings.popleft())
        true_joints.append(robot.true_state())
        loop.tick(index, now_s, arrived)
        if on_tick is not None:
            on_tick(now_s / end_s)
    robot.close()
    about: dict[str, Any] = {
        "recording": placed.name,
        "kind": placed.kind,
        "subject": placed.labels.subject,
        "group": placed.labels.group,
        "controller": controller_name,
        "predictor": predictor_name,
        "neck": (robot_neck or neck).model_dump(),
        "sensor": sensor.model_dump(mode="json"),
        "seed": settings.seed,
        # Where and what else it was run with does not change a run.
        "settings": settings.model_dump(mode="json", exclude={"out", "config", "figures", "controllers", "list"}),
    }

    def where_known(times_s: FloatArray) -> FloatArray:
        return np.where(true_head.known(times_s)[:, None], true_head(times_s), np.nan)

    return recorder.finish(about, where_known, true_joints)
