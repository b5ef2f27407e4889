"""Makes the parts of a live run from its settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gazempc.controllers.controller import Controller
from gazempc.errors import SettingsError
from gazempc.live.clock import Clock, RealClock, SimulatedClock
from gazempc.live.parts import LiveParts
from gazempc.live.robots import make_robot, true_state_of
from gazempc.live.settings import STAMPED, LiveSettings
from gazempc.live.sources.bag import BagSource
from gazempc.live.sources.camera.source import CameraSource
from gazempc.live.sources.replay import ReplaySource
from gazempc.live.sources.ros2 import ANY_FRAME, Ros2Person
from gazempc.live.sources.ros4hri import Ros4HriPeople
from gazempc.live.sources.senders import Senders
from gazempc.live.sources.signing import Signatures, read_key
from gazempc.live.sources.source import Source
from gazempc.live.sources.streams import LineSource
from gazempc.live.sources.wires import StandardInput, TcpClient, UdpPort, Wire, parse_address
from gazempc.live.stamps import StampReader
from gazempc.live.telling import make_telling
from gazempc.live.watch.mends import Mends
from gazempc.loop.build import Person, make_controller, make_predictor
from gazempc.loop.planner import BackgroundPlanner, ImmediatePlanner
from gazempc.loop.target import make_target
from gazempc.neck.human import with_motion
from gazempc.neck.narrow import narrowed
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.part_options import make, options_for
from gazempc.parts import CONTROLLER, PREDICTOR, ROBOT, SOURCE, name_of
from gazempc.people.cues import Cues
from gazempc.recordings.truth import TrueHead
from gazempc.results.run_info import RunInfo
from gazempc.sim.scene import Scene, make_scene
from gazempc.types import FloatArray

TrueHeadAt = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Built:
    """What is made of the settings.

    Attributes:
        parts: The parts of the run.
        about: Description of the run.
        true_head_base_m: True head positions, shape (H, 3), metres, at times, shape (H,), seconds; None where a person
            is there now.
        notes: What the reader of the recording found and inferred, for people.
    """

    parts: LiveParts
    about: RunInfo
    true_head_base_m: TrueHeadAt | None
    notes: tuple[str, ...] = ()


def build(settings: LiveSettings) -> Built:
    """Make all parts; none is open or connected yet.

    Args:
        settings: The settings, checked.

    Returns:
        The parts.

    Raises:
        GazempcError: If a name does not exist, a file or option is wrong, or a part does not do what it must.
    """
    neck = with_motion(load_neck(settings.scene.neck), settings.motion)
    neck = narrowed(neck, settings.loop.gaze_region_deg, settings.loop.speed_max_rad_s)
    settings.mount.check_fits(neck)
    clock: Clock = SimulatedClock() if settings.simulated_clock else RealClock()
    scene = None
    if settings.recording is not None:
        scene = make_scene(settings.recording, settings.scene, neck, everybody=settings.attend is not None)
    stamps = None
    if isinstance(clock, RealClock) and settings.source_kind in STAMPED:
        stamps = StampReader(settings.stamps, clock)
    source = _make_source(settings, neck, clock, scene, stamps)
    true_head = None if scene is None else TrueHead(scene.walk)
    person = Person() if scene is None else Person(scene.walk.labels.subject, true_head)
    own = settings.options.own
    predictor = make_predictor(settings.predictor, settings, person, own)
    controller = make_controller(settings.controller, neck, settings, own)
    start_rad = neck.rest_rad if scene is None else _facing(scene)
    robot = make_robot(settings.robot, settings.options, neck, clock, start_rad, settings.seed)
    planner = ImmediatePlanner(controller) if settings.simulated_clock else BackgroundPlanner(controller)
    mends, cues = Mends(own_source=stamps is None), Cues()
    parts = LiveParts(
        neck,
        predictor,
        planner,
        robot,
        source,
        clock,
        settings.mount,
        settings.loop,
        stamps=stamps,
        use_ids=settings.use_ids,
        mends=mends,
        several=make_target(settings.predictor, predictor, neck, settings, own, cues) if settings.several else None,
        cues=cues,
        telling=make_telling(settings, neck, clock, settings.source_kind == "ros4hri"),
    )
    # Among several people nobody keeps, live, who is which of the recordings.
    known = None if true_head is None or (scene is not None and scene.others) else _on_loop_clock(true_head, source)
    names = {
        "controller": name_of(CONTROLLER, controller),
        "predictor": name_of(PREDICTOR, predictor),
        "robot": name_of(ROBOT, robot),
    }
    about = _about(settings, neck, scene, names)
    if settings.simulated_clock and true_state_of(robot) is not None:
        # At the tick itself; on a real clock a robot is asked a little later.
        about = about.model_copy(update={"joints": "true"})
    notes = () if scene is None else scene.walk.notes
    return Built(parts, about, known, (*notes, *_margins(controller)))


def _margins(controller: Controller) -> list[str]:
    """What of the neck file leaves too little margin to the MPC."""
    if name_of(CONTROLLER, controller) not in ("mpc", "perfect"):
        return []
    # Only here: another controller needs no CasADi.
    from gazempc.controllers.mpc.mpc import Mpc  # noqa: PLC0415
    from gazempc.margins.margins import too_small  # noqa: PLC0415

    return too_small(controller) if isinstance(controller, Mpc) else []


def _make_source(
    settings: LiveSettings, neck: NeckSpec, clock: Clock, scene: Scene | None, stamps: StampReader | None
) -> Source:
    kind, address = settings.source_kind, settings.source.partition(":")[2]
    if scene is not None:
        played = BagSource(scene.walk, clock, scene.others) if kind == "bag" else None
        return played or ReplaySource(scene.walk, scene.sensor, scene.seed, clock, settings.passes, scene.others)
    if kind not in SOURCE.shipped:
        given = {"clock": clock, "clock_s": clock.now_s, "neck": neck, "seed": settings.seed}
        own: Source = make(SOURCE, kind, given, options_for(SOURCE, kind, settings.options.own))
        return own
    if kind == "camera" and isinstance(clock, RealClock):
        return CameraSource(address, settings.camera, clock)
    if not isinstance(clock, RealClock) or stamps is None:
        raise SettingsError(f"source {settings.source!r} keeps real time")
    if kind == "ros4hri":
        ros2 = settings.options.ros2
        return Ros4HriPeople(clock.now_s, stamps.now_loop_s, ros2.network, ros2.base_frame)
    if kind == "ros2":
        ros2 = settings.options.ros2
        frame_id = None if settings.mount.axes == "flu" else ANY_FRAME
        return Ros2Person(address, clock.now_s, stamps.now_loop_s, ros2.network, ros2.pose_type, frame_id)
    wire: Wire = StandardInput()
    if kind in ("udp", "tcp"):
        named = parse_address(settings.source, address, "127.0.0.1")
        wire = UdpPort(*named) if kind == "udp" else TcpClient(*named)
    signatures = None if settings.key_file is None else Signatures(read_key(settings.key_file))
    return LineSource(wire, clock, stamps, Senders(settings.allow, signatures is not None), signatures)


def _facing(scene: Scene) -> FloatArray:
    """Where a simulated neck looks at the first head, or beside it, shape (N,), radians."""
    truth = scene.walk.truth
    return scene.neck.command_limits.clip_position(scene.first_angles_rad(truth.head_position_m[truth.valid][0]))


def _on_loop_clock(true_head: TrueHead, source: Source) -> TrueHeadAt:
    def at(times_s: FloatArray) -> FloatArray:
        own_s = source.own_s(times_s) if isinstance(source, ReplaySource) else times_s
        return np.where(true_head.known(own_s)[:, None], true_head(own_s), np.nan)

    return at


def _about(settings: LiveSettings, neck: NeckSpec, scene: Scene | None, names: dict[str, str]) -> RunInfo:
    walk = None if scene is None else scene.walk
    return RunInfo(
        recording=settings.source if scene is None else scene.name,
        kind="live" if walk is None else walk.kind,
        subject="unknown" if walk is None else walk.labels.subject,
        group=None if walk is None else walk.labels.group,
        neck=neck,
        sensor={"name": "live" if scene is None else scene.sensor.name},
        seed=settings.seed,
        mode="live",
        joints="measured",
        settings=settings.model_dump(mode="json", exclude={"out", "figures"}),
        **names,
    )
