"""What a `gazempc.live.gaze.Gaze` is made of, from names and objects of the user's own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from gazempc.controllers.controller import Controller
from gazempc.errors import SettingsError
from gazempc.live.clock import RealClock
from gazempc.live.parts import Keeping, LiveParts
from gazempc.live.robots import make_robot, true_state_of
from gazempc.live.run import LiveRun
from gazempc.live.settings import MountedSettings
from gazempc.live.sources.pushed import PushedSource
from gazempc.live.sources.source import Source
from gazempc.live.stamps import StampClock, StampReader, Stamps
from gazempc.live.telling import make_telling
from gazempc.live.watch.mends import Mends
from gazempc.loop.build import Person, make_controller, make_predictor
from gazempc.loop.planner import BackgroundPlanner
from gazempc.loop.target import make_target
from gazempc.loop.track import Target
from gazempc.neck.human import with_motion
from gazempc.neck.narrow import narrowed
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.part_options import check_options
from gazempc.parts import CONTROLLER, PREDICTOR, ROBOT, check_methods, name_of
from gazempc.people.cues import Cues
from gazempc.results.run_info import RunInfo
from gazempc.robots.robot import Robot
from gazempc.specfiles import explain
from gazempc.types import FloatArray, JointState
from predictors import Predictor


class LiveGazeSettings(MountedSettings):
    """Settings of `gazempc.live.gaze.Gaze`."""

    clock: StampClock = Field(
        default="unix", description="Clock of the capture times that `see` is given: unix, monotonic, other or arrival"
    )
    keep_minutes: float = Field(default=10.0, gt=0, le=600, description="How much of the run the log holds")


class MonotonicRobot:
    """Puts the times of a robot's readings on the loop's clock: it was made before that clock was.

    Args:
        inner: The robot; it stamps its joints with `time.monotonic`.
        clock: The loop's clock.
    """

    def __init__(self, inner: Robot, clock: RealClock) -> None:
        self._inner, self._clock = inner, clock

    def connect(self) -> None:
        """See `gazempc.robots.robot.Robot.connect`."""
        self._inner.connect()

    def read_state(self) -> JointState | None:
        """See `gazempc.robots.robot.Robot.read_state`."""
        state = self._inner.read_state()
        return None if state is None else replace(state, time_s=self._clock.from_monotonic_s(state.time_s))

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """See `gazempc.robots.robot.Robot.send_command`."""
        return self._inner.send_command(position_rad)

    def close(self) -> None:
        """See `gazempc.robots.robot.Robot.close`."""
        self._inner.close()


@dataclass(frozen=True)
class GazeParts:
    """Everything that is made before the robot is connected.

    Attributes:
        about: Description of the run.
        neck: The neck.
        predictor: Forecasts the head.
        controller: Makes the plans.
        robot: Executes the commands.
        source: Takes observations from the program.
        clock: The loop's clock.
        stamps: How the times that `see` is given are read.
        settings: The settings.
        several: Whom to look at, where that is one of several people, or is looked away from; None for one person.
        cues: What the program tells besides observations.
        telling: Listens to cues of others; None for nothing.
    """

    about: RunInfo
    neck: NeckSpec
    predictor: Predictor
    controller: Controller
    robot: Robot
    source: PushedSource
    clock: RealClock
    stamps: StampReader
    settings: LiveGazeSettings
    several: Target | None
    cues: Cues
    telling: Source | None

    def run(self, keeping: Keeping) -> LiveRun:
        """Make the run; the planner's thread begins here.

        Args:
            keeping: Who takes the logs.

        Returns:
            The run, not started yet.
        """
        parts = LiveParts(
            self.neck,
            self.predictor,
            BackgroundPlanner(self.controller),
            self.robot,
            self.source,
            self.clock,
            self.settings.mount,
            self.settings.loop,
            stamps=self.stamps,
            use_ids=self.settings.use_ids,
            mends=Mends(python=True),
            several=self.several,
            cues=self.cues,
            telling=self.telling,
        )
        return LiveRun(parts, replace(keeping, true_state=true_state_of(self.robot)))


def check_settings(settings: dict[str, Any]) -> LiveGazeSettings:
    """Check keywords.

    Args:
        settings: Values by name.

    Returns:
        The settings.

    Raises:
        SettingsError: If there is no such setting, or its value is wrong; names each.
    """
    try:
        return LiveGazeSettings.model_validate(settings)
    except ValidationError as error:
        raise SettingsError(explain(error, "Gaze", LiveGazeSettings)) from None


def make_parts(
    neck: str | Path | NeckSpec,
    robot: str | Robot,
    controller: str | Controller,
    predictor: str | Predictor,
    settings: LiveGazeSettings,
) -> GazeParts:
    """Make all parts, or make objects of the user's own ready.

    Args:
        neck: Name of a shipped neck, path of a TOML file, or a neck.
        robot: A shipped name, ``module:Class``, or a robot.
        controller: The same of a controller.
        predictor: The same of a predictor.
        settings: The settings.

    Returns:
        The parts; none is connected yet.

    Raises:
        GazempcError: If a name does not exist, a file or option is wrong, or a part does not do what it must.
    """
    if "perfect" in (controller, predictor):
        raise SettingsError("perfect: nobody knows the true future of a live run")
    own = settings.options.own
    chosen = ((PREDICTOR, predictor), (CONTROLLER, controller), (ROBOT, robot))
    check_options([(kind, choice) for kind, choice in chosen if isinstance(choice, str)], own)
    whole = with_motion(neck if isinstance(neck, NeckSpec) else load_neck(neck), settings.motion)
    spec = narrowed(whole, settings.loop.gaze_region_deg, settings.loop.speed_max_rad_s)
    settings.mount.check_fits(spec)
    clock = RealClock()
    forecasting = make_predictor(predictor, settings, Person(), own)
    planning = make_controller(controller, spec, settings, own)
    if isinstance(robot, str):
        ready = make_robot(robot, settings.options, spec, clock, spec.rest_rad)
        called = name_of(ROBOT, ready)
    else:
        check_methods(ROBOT, robot)
        ready, called = MonotonicRobot(robot, clock), name_of(ROBOT, robot)
    about = RunInfo(
        recording="live",
        kind="live",
        subject="unknown",
        controller=name_of(CONTROLLER, planning),
        predictor=name_of(PREDICTOR, forecasting),
        neck=spec,
        sensor={"name": "live"},
        mode="live",
        robot=called,
        joints="measured",
        settings=settings.model_dump(mode="json"),
    )
    stamps = StampReader(Stamps(clock=settings.clock), clock)
    source = PushedSource(clock, stamps)
    cues = Cues()
    several = make_target(predictor, forecasting, spec, settings, own, cues) if settings.several else None
    telling = make_telling(settings, spec, clock, mounted=False)
    return GazeParts(about, spec, forecasting, planning, ready, source, clock, stamps, settings, several, cues, telling)
