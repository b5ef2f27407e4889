"""Settings of a live run, and checks of their compatibility."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, Field, field_validator

from gazempc.errors import SettingsError
from gazempc.live.mount import Mount
from gazempc.live.robots import keeps_any_clock
from gazempc.live.sources.camera.capture import CAMERA, CameraOptions, check_address
from gazempc.live.sources.source import SourceError
from gazempc.live.stamps import Stamps
from gazempc.neck.limits import MOTION_MEANS, Motion
from gazempc.part_options import check_options
from gazempc.parts import ADDRESSED, CONTROLLER, PREDICTOR, ROBOT, SOURCE, find, is_own, split_address
from gazempc.robots.options import RobotChoice, RobotOptions
from gazempc.robots.ptz_emulator import EMULATOR, FOV_DEG, LATENCY_S, VIEW_DEG
from gazempc.settings import DEFAULT_PREDICTOR, ControllerChoice, GazeSettings, LoopSettings, PredictorChoice
from gazempc.sim.scene import SceneSettings, StageSettings

_Group = TypeVar("_Group", bound=BaseModel)
ViewKind = Literal["foxglove", "web"]
# Default port of Foxglove, and an unprivileged one for pages.
PORTS: dict[ViewKind, int] = {"foxglove": 8765, "web": 8080}
# Sources with time stamps of another clock.
STAMPED = ("stdin", "udp", "tcp", "ros2", "ros4hri")
SOURCES = (
    "stdin, udp:PORT, udp:HOST:PORT, tcp:HOST:PORT, replay, bag:PATH, ros2:TOPIC, ros4hri, camera, camera:1, "
    "camera:FILE, module:Class for your own source"
)


_DELAY = LoopSettings.model_fields["compute_delay_s"]


class LiveLoopSettings(LoopSettings):
    """Timeouts and limits of a loop whose plans are made in the background."""

    compute_delay_s: float = Field(default=0.01, ge=0, le=0.1, description=_DELAY.description)


class MountedSettings(GazeSettings):
    """Settings of a live run from Python and from the command line."""

    motion: Motion = Field(default="robot", description=MOTION_MEANS)
    mount: Mount = Mount()
    use_ids: bool = Field(default=True, description="Use the tracker's names of people")
    loop: LiveLoopSettings = LiveLoopSettings()
    options: RobotOptions = RobotOptions()

    @field_validator("loop", mode="before")
    @classmethod
    def _of_a_live_loop(cls, loop: Any) -> Any:
        # A plain `LoopSettings` keeps its values and gets the computing delay of a live loop.
        return loop.model_dump(exclude_unset=True) if type(loop) is LoopSettings else loop


class LiveSettings(MountedSettings, StageSettings):
    """Settings of `python -m gazempc.live`."""

    source: str = Field(description=f"Source of observations: {SOURCES}")
    robot: RobotChoice = Field(default="simulated", description="Robot to command; module:Class for your own")
    neck: str | None = Field(
        default=None, description="Shipped neck or a .toml file; default for a simulated robot: reference"
    )
    controller: ControllerChoice = Field(default="mpc", description="Controller of the gaze; module:Class for your own")
    predictor: PredictorChoice = Field(default=DEFAULT_PREDICTOR, description="Forecast of the head")
    replay: str = Field(default="subject03_R4", description="Recording of the source replay")
    passes: int = Field(
        default=1, ge=1, description="Number of passes of the recording by the source replay, two seconds apart"
    )
    camera: CameraOptions = CameraOptions()
    duration_s: float | None = Field(
        default=None, gt=0, description="End the run after this time; default: run until Ctrl-C"
    )
    stamps: Stamps = Stamps()
    allow: tuple[str, ...] = Field(
        default=(), description="Source udp: addresses or networks, the first sender of which is read; default: any"
    )
    key_file: Path | None = Field(default=None, description="Removed: it is refused; tunnel the lines instead")
    simulated_clock: bool = Field(
        default=False, description="Run as fast as the computer can; only if source and robot do not need real time"
    )
    isolate: Literal["predictor"] | None = Field(
        default=None, description="Run the predictor in a separate process, for one that holds Python's lock for long"
    )
    log_s: float = Field(default=300.0, ge=1, description="Length of a log; after this time a new log begins")
    out: Path = Field(default=Path("out/live"), description="Folder for all files; replaces an earlier run")
    log: Literal["npz", "mcap"] | None = Field(
        default=None,
        description="Format of the logs; mcap: beside .npz, during the run, for Foxglove and other viewers. "
        "Default: mcap if the extra view is installed",
    )
    view: ViewKind | None = Field(
        default=None,
        description="Watch the run: web (a page in any browser) or foxglove (also --view alone)",
    )
    view_at: str = Field(
        default="127.0.0.1",
        description="HOST or HOST:PORT of the viewer; 0.0.0.0 for the whole network. Default port: 8080 for "
        "web, 8765 for foxglove",
    )
    attention_out: str | None = Field(
        default=None,
        description="Send a line of JSON at each change of the attended person or gaze aversion: udp:HOST:PORT, "
        "ros2:TOPIC, or a file FILE.jsonl",
    )
    figures: bool = Field(default=True, description="Draw angles.png from the last log")
    probe: bool = Field(
        default=False,
        description="Robots visca and onvif: print identity and functions of the camera without moving it, then end",
    )

    @property
    def source_kind(self) -> str:
        """Name of the shipped source, or ``module:Class``."""
        kind = self.source.partition(":")[0]
        return kind if kind in SOURCE.shipped else self.source

    @property
    def recording(self) -> str | None:
        """The recording, or folder of a bag, to replay; None for a real person."""
        address = self.source.partition(":")[2]
        return {"replay": address or self.replay, "bag": address}.get(self.source_kind)

    @property
    def view_address(self) -> tuple[str, int]:
        """Host and port of the viewer's server."""
        host, colon, port = self.view_at.partition(":")
        return host, int(port) if colon else PORTS[self.view or "web"]

    @property
    def scene(self) -> SceneSettings:
        """The scene of the sources replay and bag."""
        values = {name: getattr(self, name) for name in StageSettings.model_fields}
        return SceneSettings(**values, neck=self.neck or SceneSettings().neck)

    @property
    def simulated_robot(self) -> bool:
        """Whether the robot uses the loop's time."""
        return keeps_any_clock(ROBOT, self.robot)


def for_turning_camera(settings: LiveSettings) -> LiveSettings:
    """Defaults for a turning camera, for settings that the user has not set.

    Args:
        settings: The settings.

    Returns:
        The same for any other robot.
    """
    robot, address = split_address(settings.robot)
    if robot not in ADDRESSED:
        return settings
    found: dict[str, object] = {}
    emulated = address.partition(":")[0] == EMULATOR
    if settings.neck is None and (emulated or settings.probe):
        found["neck"] = "ptz"
        if emulated and settings.framing.view_deg is None:
            found["framing"] = settings.framing.model_copy(update={"view_deg": VIEW_DEG})
    if settings.source_kind == "camera":
        # The picture is of the turning camera. Latency of network cameras: up to a second.
        found["mount"] = _filled(settings.mount, Mount(), on="head")
        usual = MountedSettings.model_fields["loop"].default
        found["loop"] = _filled(settings.loop, usual, stale_after_s=1.5, lost_after_s=2.0)
    if settings.source == f"camera:{EMULATOR}":
        found["camera"] = _filled(settings.camera, CameraOptions(), fov_deg=FOV_DEG, latency_ms=1e3 * LATENCY_S)
    return settings.model_copy(update=found)


def _filled(settings: _Group, usual: _Group, **values: Any) -> _Group:
    """Settings with these values in place of each that equals the usual one."""
    unset = {name: value for name, value in values.items() if getattr(settings, name) == getattr(usual, name)}
    return settings.model_copy(update=unset)


def check(settings: LiveSettings) -> None:
    """Check the settings for compatibility.

    Args:
        settings: The settings.

    Raises:
        SettingsError: If a user-defined part is not found, an option is not used by any part, or settings are
            incompatible.
        SourceError: If there is no such source.
    """
    source, robot = settings.source_kind, settings.robot
    if source not in SOURCE.shipped and not is_own(source):
        raise SourceError(f"--source {settings.source}: no such source; accepted: {SOURCES}")
    chosen = [
        (PREDICTOR, settings.predictor), (CONTROLLER, settings.controller), (ROBOT, robot), (SOURCE, source)
    ]  # fmt: skip
    if source == "camera":
        check_address(settings.source)
        chosen.append((CAMERA, settings.source.partition(":")[2]))
    for kind, choice in chosen:
        if is_own(choice):
            find(kind, choice)
    check_options(chosen, settings.options.own)
    if settings.simulated_clock and not (keeps_any_clock(SOURCE, source) and settings.simulated_robot):
        simulated = ", ".join(name for name in ROBOT.shipped if keeps_any_clock(ROBOT, name))
        raise SettingsError(
            f"--simulated-clock: source {settings.source!r} or robot {robot!r} needs real time; accepted with it: "
            f"source replay, robots {simulated}, and own parts whose class has keeps_any_clock = True"
        )
    host, colon, port = settings.view_at.partition(":")
    out, several = settings.attention_out, settings.several
    wrong = {
        "--key-file: lines are not signed any more; keep to the loopback, and bring them there through a tunnel: "
        "--source tcp:127.0.0.1:5005 with `ssh -N -L 5005:127.0.0.1:5005 TRACKER`, or WireGuard for UDP": (
            settings.key_file is not None
        ),
        "--isolate: accepted for one person (no --attend, looks away or camera) on a real clock": (
            settings.isolate is not None and (several or source == "camera" or settings.simulated_clock)
        ),
        f"--view-at {settings.view_at}: accepted: HOST or HOST:PORT, such as 0.0.0.0:8080": (
            not host or (colon and not (port.isdecimal() and int(port) < 65536))
        ),
        "--view: accepted without --simulated-clock": settings.view is not None and settings.simulated_clock,
        f"--neck: a real robot ({robot}) needs its own neck file, with its limits; see python -m "
        "gazempc.identify": settings.neck is None and not settings.simulated_robot,
        "--predictor perfect: the true future of a live run is unknown": settings.predictor == "perfect",
        "--attention-out: there is one person; accepted with --attend or --look-away.rhythm": (
            out is not None and not several
        ),
        f"--attention-out {out}: ROS 2 needs real time; accepted with a simulated clock: FILE.jsonl": (
            out is not None and out.startswith("ros2:") and settings.simulated_clock
        ),
        f"--source {settings.source}: no bag; accepted: bag:PATH, the folder of a ROS 2 bag": settings.recording == "",
        f"--sensor {settings.sensor}: the source bag has its tracker's measurements; for another sensor use "
        f"--source replay --replay {settings.recording}": settings.sensor is not None and source == "bag",
        f"--mount.on {settings.mount.on}: a replay is seen from the robot's base; accepted with source {source}: "
        "mount.on base": settings.mount.moves and settings.recording is not None,
    }
    for message, applies in wrong.items():
        if applies:
            raise SettingsError(message)
    _check_used(settings, source)


def _check_used(settings: LiveSettings, source: str) -> None:
    """Refuse settings not used by the source."""
    taken_by = {"stamps": STAMPED, "allow": ("udp",), "camera": ("camera",), "passes": ("replay",)}
    if settings.recording is None:
        # Own robots and sources take the seed, too.
        stage = {name for name in StageSettings.model_fields if name != "seed"}
        taken_by |= {name: ("replay",) if name == "sensor" else ("replay", "bag") for name in stage}
    for name, sources in taken_by.items():
        field = type(settings).model_fields[name]
        if source not in sources and getattr(settings, name) != field.get_default(call_default_factory=True):
            raise SettingsError(
                f"--{name.replace('_', '-')}: source {settings.source!r} does not use it; accepted with --source "
                f"{', '.join(sources)}"
            )
