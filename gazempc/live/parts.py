"""What a live run joins, and where its logs go: two values that pass to the run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gazempc.live.clock import Clock
from gazempc.live.mount import Mount
from gazempc.live.sources.source import Source
from gazempc.live.stamps import StampReader
from gazempc.live.status import Status
from gazempc.live.watch.mends import Mends
from gazempc.loop.planner import Planner
from gazempc.loop.track import PersonTrack, Target
from gazempc.neck.spec import NeckSpec
from gazempc.people.cues import Cues
from gazempc.people.state import AttentionState
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.moments import Moment
from gazempc.results.run_info import RunInfo
from gazempc.robots.robot import Robot
from gazempc.settings import LoopSettings
from gazempc.types import FloatArray, JointState
from predictors import Predictor

Keep = Callable[[Log, ComputeTimes], None]


@dataclass(frozen=True)
class LiveParts:
    """The parts of a live run; none of them is open or connected yet.

    Attributes:
        neck: The neck as the controller knows it.
        predictor: Forecasts the head.
        planner: Asks the controller for plans.
        robot: Executes commands.
        source: Gives observations.
        clock: The clock of all of these.
        mount: Where the sensor is.
        settings: When the loop gives up on something.
        stamps: How the source's time stamps are read; None if it gives the loop's times.
        use_ids: Whether the tracker's names of people count.
        mends: How settings are named to the user.
        several: Whom to look at, where that is one of several people, or is looked away from; None for one person.
        cues: What is told besides observations, for that target.
        telling: Listens to cues besides the source; None for nothing.

    Raises:
        SettingsError: If a joint of the neck takes speeds: the start of a live run sends angles.
    """

    neck: NeckSpec
    predictor: Predictor
    planner: Planner
    robot: Robot
    source: Source
    clock: Clock
    mount: Mount = field(default_factory=Mount)
    settings: LoopSettings = field(default_factory=LoopSettings)
    stamps: StampReader | None = None
    use_ids: bool = True
    mends: Mends = field(default_factory=Mends)
    several: Target | None = None
    cues: Cues = field(default_factory=Cues)
    telling: Source | None = None

    def target(self) -> Target:
        """Whom the loop looks at."""
        return PersonTrack(self.predictor, self.settings) if self.several is None else self.several

    def __post_init__(self) -> None:
        self.neck.check_takes_angles("a live run")


def _unknown(times_s: FloatArray) -> FloatArray:
    return np.full((times_s.size, 3), np.nan)


@dataclass(frozen=True)
class Keeping:
    """What the logs of a live run say, and who takes them.

    Attributes:
        about: Description of the run.
        keep: Takes each log as soon as it is complete, in a thread of its own.
        log_s: Length of a log, seconds.
        true_head_base_m: True head positions, shape (H, 3), metres, at times, shape (H,), seconds; NaN where they are
            not known.
        true_state: Where the joints of a simulated robot really are; None for any other robot.
        show: Takes a status four times a second, in the thread of the run: it must return at once. None for nobody.
        tell: Is told at every tick the time, seconds, and whom the robot looks at, in the thread of the run; returns at
            once what could not be passed on before, and why. None for nobody.
        watch: Is told what happens as it happens, in the thread of the run, and returns at once; None for nobody.
    """

    about: RunInfo
    keep: Keep
    log_s: float = 300.0
    true_head_base_m: Callable[[FloatArray], FloatArray] = _unknown
    true_state: Callable[[], JointState] | None = None
    show: Callable[[Status], None] | None = None
    tell: Callable[[float, AttentionState], Sequence[Exception]] | None = None
    watch: Callable[[Moment], None] | None = None
