"""All parts of a live run, made from settings or from objects of a program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, ValidationError

from gazempc.controllers.controller import Controller
from gazempc.errors import SettingsError
from gazempc.live.clock import Clock, RealClock, SimulatedClock
from gazempc.live.mount import Mount
from gazempc.live.process import IsolatedPredictor
from gazempc.live.robots import MonotonicRobot, make_robot
from gazempc.live.settings import STAMPED, LiveSettings, MountedSettings
from gazempc.live.sources.camera.capture import CAMERA
from gazempc.live.sources.camera.source import CameraSource
from gazempc.live.sources.pushed import PushedSource
from gazempc.live.sources.replay import BagSource, ReplaySource
from gazempc.live.sources.ros2 import Ros2Input, Ros2Person
from gazempc.live.sources.ros2_cues import make_cue_source
from gazempc.live.sources.ros4hri import Ros4HriPeople
from gazempc.live.sources.source import Source
from gazempc.live.sources.streams import LineSource, Senders
from gazempc.live.sources.wires import StandardInput, TcpClient, UdpPort, Wire, parse_address
from gazempc.live.stamps import SetupHints, StampClock, StampReader, Stamps
from gazempc.loop.build import Person, make_controller, make_predictor, make_target
from gazempc.loop.planner import BackgroundPlanner, ImmediatePlanner, Planner
from gazempc.loop.pointing import Goal
from gazempc.loop.track import Target
from gazempc.neck.limits import narrowed, with_motion
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.part_options import check_options, make, options_for
from gazempc.parts import CONTROLLER, PREDICTOR, ROBOT, SOURCE, check_members, name_of
from gazempc.people.company import Cues
from gazempc.recordings.recording import TrueHead
from gazempc.results.log import RunInfo
from gazempc.robots.robot import Robot
from gazempc.settings import LoopSettings
from gazempc.sim.scene import Scene, make_scene
from gazempc.specfiles import explain
from gazempc.types import FloatArray
from predictors import Predictor

TrueHeadAt = Callable[[FloatArray], FloatArray]
# Length of the logs of a `Gaze`: short, as the construction of a log may block the servo thread.
_GAZE_LOG_S = 30.0


class LiveGazeSettings(MountedSettings):
    """Settings of `gazempc.live.gaze.Gaze`."""

    clock: StampClock = Field(
        default="unix", description="Clock of the capture times of `see`: unix, monotonic, other or arrival"
    )
    source: str | None = Field(
        default=None, description="Observations besides those of `see`: ros2:TOPIC or ros4hri; default: none"
    )
    keep_minutes: float = Field(default=10.0, gt=0, le=600, description="Length of the log")


def _unknown(times_s: FloatArray) -> FloatArray:
    return np.full((times_s.size, 3), np.nan)


@dataclass(frozen=True)
class LiveSetup:
    """All parts of a live run; none of them is open or connected yet.

    Attributes:
        about: Description of the run.
        neck: The neck model.
        predictor: Forecasts the head.
        controller: Computes plans.
        robot: Executes commands. A simulated one has `true_state`, see `gazempc.robots.robot.Robot`.
        source: Provides observations.
        clock: The clock of all parts.
        mount: Mounting pose of the sensor.
        loop: Timeouts of the loop.
        make_planner: Factory of the planner; its thread, if any, starts with the run.
        stamps: Reader of the source's time stamps; None if the source provides times of the loop.
        use_ids: Whether the tracker's names of people are used.
        hints: Names of the settings in warnings.
        several: Target with several people or with gaze aversion; None for one person.
        cues: Cues for that target.
        goal: Gaze goal with precedence over people.
        more_sources: Further sources of observations or cues; the run ends with `source`.
        true_head_base_m: Maps times, shape (H,), seconds, to true head positions, shape (H, 3), metres; NaN if unknown.
        log_s: Length of a log, seconds.
        notes: Notes on recording and neck for the user, a line each.
    """

    about: RunInfo
    neck: NeckSpec
    predictor: Predictor
    controller: Controller
    robot: Robot
    source: Source
    clock: Clock
    mount: Mount = field(default_factory=Mount)
    loop: LoopSettings = field(default_factory=LoopSettings)
    make_planner: Callable[[Controller], Planner] = BackgroundPlanner
    stamps: StampReader | None = None
    use_ids: bool = True
    hints: SetupHints = field(default_factory=SetupHints)
    several: Target | None = None
    cues: Cues = field(default_factory=Cues)
    goal: Goal = field(default_factory=Goal)
    more_sources: tuple[Source, ...] = ()
    true_head_base_m: TrueHeadAt = _unknown
    log_s: float = 300.0
    notes: tuple[str, ...] = ()


def build(settings: LiveSettings) -> LiveSetup:
    """Make the parts of a run of the command line.

    Args:
        settings: The settings, checked.

    Returns:
        The parts.

    Raises:
        GazempcError: If a name does not exist, a file or option is wrong, or a part lacks a method.
    """
    if settings.source_kind == "camera" and settings.attend is None:
        settings = settings.model_copy(update={"attend": "nearest"})  # a picture may show several people
    neck = _narrowed(load_neck(settings.scene.neck), settings)
    clock: Clock = SimulatedClock() if settings.simulated_clock else RealClock()
    scene = None
    if settings.recording is not None:
        scene = make_scene(settings.recording, settings.scene, neck, all_people=settings.attend is not None)
    stamps = StampReader(settings.stamps, clock) if clock.is_real and settings.source_kind in STAMPED else None
    source = _make_source(settings, neck, clock, scene, stamps)
    chosen = settings.predictor, settings.controller, settings.robot
    recording = settings.source if scene is None else scene.name
    setup = _joined(settings, neck, clock, source, chosen, recording, scene, settings.seed)
    if settings.isolate is not None:
        person = Person() if scene is None else Person(scene.walk.labels.subject)
        make_there = partial(make_predictor, settings.predictor, settings, person, settings.options.own)
        setup = replace(setup, predictor=IsolatedPredictor(make_there))
    return replace(
        setup,
        make_planner=ImmediatePlanner if settings.simulated_clock else BackgroundPlanner,
        stamps=stamps,
        hints=SetupHints(own_source=stamps is None, judges_rate=settings.source_kind != "camera"),
        more_sources=make_cue_source(settings, neck, clock, mounted=settings.source_kind == "ros4hri"),
        log_s=settings.log_s,
        notes=(*(() if scene is None else scene.walk.notes), *_margins(setup.controller)),
    )


def setup_of_gaze(
    neck: str | Path | NeckSpec,
    robot: str | Robot,
    controller: str | Controller,
    predictor: str | Predictor,
    settings: dict[str, Any],
) -> tuple[LiveSetup, PushedSource, LiveGazeSettings]:
    """Make the parts of a `gazempc.live.gaze.Gaze`, or validate objects of a program.

    Args:
        neck: Name of a shipped neck, path of a TOML file, or a neck.
        robot: A shipped name, ``module:Class``, or a robot.
        controller: A shipped name, ``module:Class``, or a controller.
        predictor: A shipped name, ``module:Class``, or a predictor.
        settings: Settings by name.

    Returns:
        The parts, the source with observations from the program, and the checked settings.

    Raises:
        GazempcError: If a name does not exist, a file, setting or option is wrong, or a part lacks a method.
    """
    try:
        checked = LiveGazeSettings.model_validate(settings)
    except ValidationError as error:
        raise SettingsError(explain(error, "Gaze", LiveGazeSettings)) from None
    chosen = ((PREDICTOR, predictor), (CONTROLLER, controller), (ROBOT, robot))
    check_options([(kind, choice) for kind, choice in chosen if isinstance(choice, str)], checked.options.own)
    spec = _narrowed(neck if isinstance(neck, NeckSpec) else load_neck(neck), checked)
    clock = RealClock()
    stamps = StampReader(Stamps(clock=checked.clock), clock)
    source = PushedSource(clock, stamps)
    setup = _joined(checked, spec, clock, source, (predictor, controller, robot))
    people: tuple[Source, ...] = ()
    if checked.source is not None:  # its clock may differ from that of `see`
        people = (_ros2_source(checked.source, checked, clock, StampReader(stamps.stamps, clock)),)
    setup = replace(
        setup,
        stamps=stamps,
        hints=SetupHints(python=True),
        more_sources=(*people, *make_cue_source(checked, spec, clock, mounted=checked.source is not None)),
        log_s=_GAZE_LOG_S,
    )
    return setup, source, checked


def _narrowed(neck: NeckSpec, settings: MountedSettings) -> NeckSpec:
    moved = with_motion(neck, settings.motion)
    narrow = narrowed(moved, settings.loop.gaze_region_deg, settings.loop.speed_max_rad_s, settings.framing)
    if not (neck.reports_joints or np.array_equal(narrow.rest_rad, moved.rest_rad)):
        # Assumed to be at rest: a first command elsewhere would be a step.
        raise SettingsError(
            f"loop.gaze_region_deg: neck {neck.name!r} reports no joints and starts at rest, at "
            f"{np.rad2deg(moved.rest_rad).round(1).tolist()} deg ({', '.join(neck.joint_names)}), to which the region "
            f"allows no command (nearest: {np.rad2deg(narrow.rest_rad).round(1).tolist()}); accepted: one that does"
        )
    if settings.mount.on == "eye" and neck.eyes is None:
        raise SettingsError(f"--mount.on eye: neck {neck.name!r} has no eyes that turn; accepted: base, head")
    return narrow


def _joined(
    settings: MountedSettings,
    neck: NeckSpec,
    clock: Clock,
    source: Source,
    chosen: tuple[str | Predictor, str | Controller, str | Robot],
    recording: str = "live",
    scene: Scene | None = None,
    seed: int = 0,
) -> LiveSetup:
    """The common parts of both ways to start a run; `chosen` by name or as objects."""
    own, cues, walk = settings.options.own, Cues(), None if scene is None else scene.walk
    true_head = None if walk is None else TrueHead(walk)
    person = Person() if walk is None else Person(walk.labels.subject, true_head)
    predictor = make_predictor(chosen[0], settings, person, own)
    controller = make_controller(chosen[1], neck, settings, own)
    robot, start_rad = chosen[2], neck.rest_rad if scene is None else _facing(scene)
    if isinstance(robot, str):
        robot = ready = make_robot(robot, settings.options, neck, clock, start_rad, seed)
    else:
        check_members(ROBOT, robot)
        ready = MonotonicRobot(robot, clock)
    about = RunInfo(
        recording=recording,
        kind="live" if walk is None else walk.kind,
        subject="unknown" if walk is None else walk.labels.subject,
        group=None if walk is None else walk.labels.group,
        controller=name_of(CONTROLLER, controller),
        predictor=name_of(PREDICTOR, predictor),
        neck=neck,
        sensor={"name": "live" if scene is None else scene.sensor.name},
        seed=seed,
        mode="live",
        robot=name_of(ROBOT, robot),
        # Read at the tick itself; on a real clock a robot is read slightly later.
        joints="measured" if clock.is_real or not hasattr(ready, "true_state") else "true",
        settings=settings.model_dump(mode="json", exclude={"out", "figures"}),
    )
    setup = LiveSetup(about, neck, predictor, controller, ready, source, clock, settings.mount, settings.loop)
    # True identities of several people are not tracked live.
    if true_head is not None and scene is not None and not scene.others:
        setup = replace(setup, true_head_base_m=_on_loop_clock(true_head, source))
    several = make_target(chosen[0], predictor, neck, settings, own, cues) if settings.several else None
    return replace(setup, use_ids=settings.use_ids, cues=cues, several=several)


def _margins(controller: Controller) -> list[str]:
    """Warnings about small stability margins of the MPC with the neck file."""
    if name_of(CONTROLLER, controller) != "mpc":
        return []
    # Local import: other controllers need no CasADi.
    from gazempc.controllers.mpc.mpc import Mpc  # noqa: PLC0415
    from gazempc.margins.margins import too_small  # noqa: PLC0415

    return too_small(controller) if isinstance(controller, Mpc) else []


def _make_source(
    settings: LiveSettings, neck: NeckSpec, clock: Clock, scene: Scene | None, stamps: StampReader | None
) -> Source:
    kind, address = settings.source_kind, settings.source.partition(":")[2]
    if scene is not None and kind == "bag":
        return BagSource(scene.walk, clock, scene.others)
    if scene is not None:
        return ReplaySource(scene.walk, scene.sensor, scene.seed, clock, settings.passes, scene.others)
    if kind not in SOURCE.shipped:
        given = {"clock": clock, "clock_s": clock.now_s, "neck": neck, "seed": settings.seed}
        own: Source = make(SOURCE, kind, given, options_for(SOURCE, kind, settings.options.own))
        return own
    if kind == "camera":
        return CameraSource(address, settings.camera, clock, options_for(CAMERA, address, settings.options.own))
    assert stamps is not None  # the other sources need real time
    if kind in ("ros2", "ros4hri"):
        return _ros2_source(settings.source, settings, clock, stamps)
    wire: Wire = StandardInput()
    if kind in ("udp", "tcp"):
        named = parse_address(settings.source, address, "127.0.0.1")
        wire = UdpPort(*named) if kind == "udp" else TcpClient(*named)
    return LineSource(wire, clock, stamps, Senders(settings.allow))


def _ros2_source(source: str, settings: MountedSettings, clock: Clock, stamps: StampReader) -> Source:
    """The source of ``ros2:TOPIC`` or ``ros4hri``."""
    kind, _, topic = source.partition(":")
    given = Ros2Input(clock.now_s, stamps.now_loop_s, settings.options.ros2)
    if kind == "ros4hri":
        return Ros4HriPeople(given)
    if kind == "ros2":
        return Ros2Person(topic, given, settings.mount.axes != "flu")
    raise SettingsError(f"source {source!r}: accepted: ros2:TOPIC, ros4hri")


def _facing(scene: Scene) -> FloatArray:
    """Initial angles of a simulated neck: at the first head, or beside it, shape (N,), radians."""
    truth = scene.walk.truth
    return scene.neck.command_limits.clip_position(scene.first_angles_rad(truth.head_position_m[truth.valid][0]))


def _on_loop_clock(true_head: TrueHead, source: Source) -> TrueHeadAt:
    def at(times_s: FloatArray) -> FloatArray:
        own_s = source.own_s(times_s) if isinstance(source, ReplaySource) else times_s
        return np.where(true_head.known(own_s)[:, None], true_head(own_s), np.nan)

    return at
