"""Replay of a recording with a simulated neck, in simulated time."""

from __future__ import annotations

import gc
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro
from pydantic import Field

from gazempc.controllers.controller import Controller
from gazempc.errors import LeftOutError
from gazempc.loop.build import Person, make_controller, make_predictor, make_target
from gazempc.loop.events import Event
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.loop.planner import ImmediatePlanner
from gazempc.loop.recorder import JointColumns, LoopRecorder
from gazempc.loop.smoother import Smoother
from gazempc.neck.kinematics import seen_from_head
from gazempc.neck.limits import narrowed
from gazempc.parts import CONTROLLER, PREDICTOR, gaze_of, name_of
from gazempc.people.schedule import LookAways
from gazempc.people.tracker_faults import is_low_rate
from gazempc.recordings.recording import TrueHead
from gazempc.results.log import ComputeTimes, Log, RunInfo
from gazempc.results.metrics import MIN_DURATION_S
from gazempc.results.moments import Moment
from gazempc.settings import DEFAULT_PREDICTOR, GazeSettings, PredictorChoice
from gazempc.sim.crowd import Crowd, PerfectOfCrowd
from gazempc.sim.scene import Scene, SceneSettings
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import JointState, Sighting
from predictors import Predictor


class ReplaySettings(GazeSettings, SceneSettings):
    """All settings of a replay except the recording and the controller."""

    predictor: PredictorChoice = Field(default=DEFAULT_PREDICTOR, description="Forecast of the head")
    options: Annotated[dict[str, Any], tyro.conf.Suppress] = Field(
        default={}, description="Options of parts of your own: --options.KEY VALUE, for a parameter of the constructor"
    )


class Replayed(NamedTuple):
    """Result of a replay.

    Attributes:
        log: The log.
        times: Computing times.
    """

    log: Log
    times: ComputeTimes


@contextmanager
def _without_collection() -> Iterator[None]:
    """Pause the garbage collector during a replay: a tenth of the CPU time without effect.

    It resumes after the replay's objects are freed, because its first run visits all objects allocated meanwhile.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@_without_collection()
def replay_scene(
    scene: Scene,
    controller: Controller | str,
    predictor: Predictor | str,
    settings: ReplaySettings = ReplaySettings(),  # noqa: B008  (frozen)
    on_tick: Callable[[float], None] | None = None,
    watch: Callable[[Moment], None] | None = None,
    look_aways: LookAways | None = None,
) -> Replayed:
    """Replay a scene for one controller on a simulated neck.

    The neck starts at rest, looking at the first observed head, or at the start offset of the scene. Deterministic: the
    same arguments give a bitwise identical log.

    Args:
        scene: Walk, neck, sensor and seed.
        controller: A controller, or its name; ``mpc+perfect`` includes the name of its predictor.
        predictor: A predictor, or its name.
        settings: Parameters of the parts given by name, and of the loop. Values of the scene have precedence.
        on_tick: Called at each tick with the completed share of the recording, 0 to 1.
        watch: Called with each moment when it is recorded.
        look_aways: Schedule of gaze aversion; default: from the settings.

    Returns:
        The log and the computing times.

    Raises:
        LeftOutError: If the recording is too short to be scored.
        SettingsError: If construction of a part fails, or its interface is violated.
    """
    walk = scene.walk
    limits = settings.loop.gaze_region_deg, settings.loop.speed_max_rad_s, settings.framing
    neck = narrowed(scene.neck, *limits)
    robot_neck = neck if scene.robot_neck is None else narrowed(scene.robot_neck, *limits)
    end_s = float(walk.times_s[-1])
    if end_s < MIN_DURATION_S:
        least = f"at least {MIN_DURATION_S} s are needed"
        raise LeftOutError(f"{walk.name}: {end_s:.2f} s is too short to be scored: {least}")
    true_head = TrueHead(walk)
    controller, own_predictor = gaze_of(controller) if isinstance(controller, str) else (controller, "")
    predictor = own_predictor or predictor
    ready = make_predictor(predictor, settings, Person(walk.labels.subject, true_head), settings.options)
    planning = make_controller(controller, neck, settings, settings.options)
    of_each = predictor
    if predictor == "perfect" and settings.attend is not None:
        of_each = PerfectOfCrowd([TrueHead(each) for each in (walk, *scene.others)])
    target = make_target(of_each, ready, neck, settings, settings.options, look_aways=look_aways)
    people = Crowd(scene, target)
    seen = deque(people.seen)
    smoother = Smoother(neck, scene.first_angles_rad(seen[0][1].observation.head_position_base_m))

    turns_with_neck = scene.sensor.view.on == "head" and scene.sensor.view.limited
    now_s = 0.0
    robot = SimulatedNeck(robot_neck, smoother.command.position_rad, lambda: now_s, scene.seed)
    true_joints = []
    recorder = LoopRecorder(neck.control_period_s, watch)
    if is_low_rate(np.array([sighting.observation.capture_time_s for _, sighting in seen])):
        recorder.event(0.0, Event.LOW_FRAME_RATE)
    loop = GazeLoop(neck, target, ImmediatePlanner(planning), smoother, robot, recorder, settings.loop)
    robot.connect()
    period_s = neck.servo_period_s
    for index in range(int(end_s * neck.servo_rate_hz + 1e-6) + 1):
        now_s = index * period_s
        true_joints.append(robot.true_state())
        arrived = []
        while seen and seen[0][1].arrival_s <= now_s + 1e-9:
            whose, sighting = seen.popleft()
            if not turns_with_neck or _in_turned_view(scene, sighting, people.heads[whose], true_joints):
                arrived.append(sighting)
        loop.tick(index, now_s, arrived)
        people.note(now_s)
        if on_tick is not None:
            on_tick(now_s / end_s)
    robot.close()

    run = RunInfo(
        recording=scene.name,
        kind=walk.kind,
        subject=walk.labels.subject,
        group=walk.labels.group,
        controller="+".join(filter(None, (name_of(CONTROLLER, planning), own_predictor))),
        predictor=name_of(PREDICTOR, ready),
        neck=robot_neck,
        sensor=scene.sensor.model_dump(mode="json"),
        seed=scene.seed,
        settings=_settings_of(scene, predictor, settings),
    )
    log, times = recorder.finish(run, people.attended_head, JointColumns(neck.joints, true_joints))
    return Replayed(people.completed(log), times)


def _in_turned_view(scene: Scene, sighting: Sighting, true_head: TrueHead, true_joints: Sequence[JointState]) -> bool:
    """Whether the person was in view of a sensor on the head, at the joint angles of the capture time."""
    captured_s = sighting.observation.capture_time_s
    neck = scene.robot_neck or scene.neck
    tick = min(max(round(captured_s * neck.servo_rate_hz), 0), len(true_joints) - 1)
    head_m = seen_from_head(neck.geometry, true_joints[tick].position_rad, true_head([captured_s])[0])
    return bool(scene.sensor.view.contains(head_m[None])[0])


def _settings_of(scene: Scene, predictor: Predictor | str, settings: ReplaySettings) -> dict[str, Any]:
    """The effective settings: values of the scene, and names in place of objects."""
    # Other settings of a command, such as the output folder, do not affect a run.
    used = settings.model_dump(mode="json", include=set(ReplaySettings.model_fields))
    return used | {
        "neck": scene.neck.name,
        "sensor": scene.sensor.name,
        "placement": scene.placement,
        "seed": scene.seed,
        "start_offset_deg": scene.start_offset_deg,
        "predictor": predictor if isinstance(predictor, str) else name_of(PREDICTOR, predictor),
    }
