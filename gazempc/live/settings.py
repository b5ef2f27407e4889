"""Settings of a live run, and what is made of them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from gazempc.errors import SettingsError
from gazempc.live.clock import Clock, RealClock
from gazempc.live.mount import Mount
from gazempc.live.sources.replay import ReplaySource
from gazempc.live.sources.ros2 import Ros2Person
from gazempc.live.sources.source import Source, SourceError
from gazempc.live.sources.streams import LineSource, StandardInput, TcpClient, UdpPort, parse_address
from gazempc.recordings.load import load
from gazempc.recordings.placement import Placement, place
from gazempc.recordings.recording import Recording
from gazempc.robots.factory import SIMULATED, RobotName, RobotOptions, ros2_network
from gazempc.settings import DEFAULT_PREDICTOR, GazeSettings, LoopSettings, PredictorChoice
from gazempc.sim.sensor import default_sensor, load_sensor

SOURCES = "stdin, udp:PORT, udp:HOST:PORT, tcp:HOST:PORT, replay, ros2:TOPIC"


class LiveSettings(GazeSettings):
    """Settings of `python -m gazempc.live`."""

    source: str = Field(description=f"Where observations come from: {SOURCES}")
    robot: RobotName = Field(default="simulated", description="What executes the commands")
    neck: str | None = Field(
        default=None, description="Shipped neck or a .toml file; without it, for a simulated robot, reference"
    )
    controller: Literal["reactive", "lookahead", "mpc"] = Field(default="mpc", description="What plans them")
    predictor: PredictorChoice = Field(default=DEFAULT_PREDICTOR, description="Forecast of the head")
    mount: Mount = Mount()
    # A plan that is made in the background is there a little later.
    loop: LoopSettings = LoopSettings(compute_delay_s=0.01)
    options: RobotOptions = RobotOptions()
    replay: str = Field(default="subject03_R4", description="Recording of the source replay")
    sensor: str | None = Field(default=None, description="Sensor of the source replay; without it what fits")
    placement: Placement | None = Field(default=None, description="Where the robot stands, for the source replay")
    distance_m: float = Field(default=2.5, gt=0, description="Distance from the walk, for placement side")
    height_m: float = Field(default=1.2, description="Height above the floor, for placement side")
    seed: int = Field(default=0, ge=0, description="Seed of simulated noise")
    duration_s: float | None = Field(default=None, gt=0, description="Longest time; without it until told to stop")
    simulated_clock: bool = Field(
        default=False, description="Run as fast as the computer can: source replay and a simulated robot only"
    )
    log_s: float = Field(default=300.0, ge=1, description="A log is written each time so many seconds have passed")
    out: Path = Field(default=Path("out/live"), description="Where to write")
    figures: bool = Field(default=True, description="Draw figures of the last log")


def check(settings: LiveSettings) -> None:
    """Refuse what does not go together.

    Args:
        settings: The settings.

    Raises:
        SettingsError: If a simulated clock is asked for where something real has its own.
        SourceError: If there is no such source.
    """
    kind = settings.source.partition(":")[0]
    if kind not in {"stdin", "udp", "tcp", "replay", "ros2"}:
        raise SourceError(f"--source {settings.source}: no such source; accepted: {SOURCES}")
    if settings.simulated_clock and (kind != "replay" or settings.robot not in SIMULATED):
        raise SettingsError(
            f"--simulated-clock: source {settings.source!r} and robot {settings.robot!r} keep real time; "
            f"accepted with it: source replay, robots {', '.join(SIMULATED)}"
        )
    if settings.neck is None and settings.robot not in SIMULATED:
        raise SettingsError(
            f"--neck: a real robot ({settings.robot}) needs its own neck file, with limits that it bears; "
            "see python -m gazempc.identify"
        )
    if settings.predictor == "perfect":
        raise SettingsError("--predictor perfect: nobody knows the true future of a live run")
    if settings.mount.on == "head" and kind == "replay":
        raise SettingsError(
            "--mount.on head: a replay is seen from the robot's base; accepted with source replay: mount.on base"
        )


def placed_recording(settings: LiveSettings) -> Recording:
    """The recording of the source replay, in the base frame.

    Args:
        settings: The settings.

    Returns:
        The recording.

    Raises:
        GazempcError: If it cannot be read or placed.
    """
    recording = load(settings.replay)
    placement: Placement = settings.placement or ("recorded" if recording.has_robot else "side")
    return place(recording, placement, settings.distance_m, settings.height_m)


def make_source(settings: LiveSettings, clock: Clock, placed: Recording | None) -> Source:
    """The source of observations; it is not open yet.

    Args:
        settings: The settings.
        clock: The loop's clock; a `RealClock` for all but replay.
        placed: The recording, for replay.

    Returns:
        The source.

    Raises:
        GazempcError: If it makes no sense.
    """
    if placed is not None:
        sensor = load_sensor(settings.sensor or default_sensor(placed))
        return ReplaySource(placed, sensor, settings.seed, clock)
    kind, _, rest = settings.source.partition(":")
    if not isinstance(clock, RealClock):
        raise SettingsError(f"source {settings.source!r} keeps real time")
    if kind == "ros2":
        return Ros2Person(rest, clock.now_s, clock.from_unix_s, ros2_network(settings.options.ros2))
    if kind == "udp":
        return LineSource(UdpPort(*parse_address(settings.source, rest, "127.0.0.1")), clock)
    if kind == "tcp":
        return LineSource(TcpClient(*parse_address(settings.source, rest, "127.0.0.1")), clock)
    return LineSource(StandardInput(), clock)
