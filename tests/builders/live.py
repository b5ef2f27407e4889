"""Live runs on a simulated clock, with faults injected into source and robot."""

import dataclasses
import threading

import numpy as np

from builders.recordings import to_and_fro
from builders.replays import NECK, run_info
from builders.robots import Spied
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.live.clock import SimulatedClock
from gazempc.live.run import LiveRun
from gazempc.live.setup import LiveSetup
from gazempc.live.sources.replay import ReplaySource
from gazempc.live.sources.source import Arrived
from gazempc.loop.planner import ImmediatePlanner
from gazempc.neck.kinematics import look_at_rad
from gazempc.recordings.recording import TrueHead
from gazempc.sim.sensor import load_sensor
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import Sighting
from predictors import ConstantVelocity

SENSOR = load_sensor("reference")
TS = NECK.servo_period_s
WALK = to_and_fro("subject03_R4", 3)


class Faulty(ReplaySource):
    """A replay source with faults: `change(now_s, sighting)` returns the sightings that replace it."""

    def __init__(self, clock, change=None, on_poll=None, walk=WALK):
        super().__init__(walk, SENSOR, 0, clock)
        self.clock = clock
        self.change, self.on_poll = change, on_poll
        self.calls = []

    def open(self):
        self.calls.append("open")
        super().open()

    def poll(self):
        now_s = self.clock.now_s()
        if self.on_poll is not None:
            self.on_poll(now_s)
        arrived = super().poll()
        if self.change is None:
            return arrived
        found = [new for sighting in arrived.sightings for new in self.change(now_s, sighting)]
        return Arrived(
            tuple(f for f in found if isinstance(f, Sighting)), tuple(f for f in found if isinstance(f, str))
        )

    def close(self):
        self.calls.append("close")
        super().close()


@dataclasses.dataclass
class Result:
    """Logs and parts of a finished run."""

    logs: list
    report: object
    robot: Spied
    source: Faulty
    duration_s: float | None
    used: int = 0
    refused: dict = dataclasses.field(default_factory=dict)

    def joined(self, name):
        return np.concatenate([getattr(log, name) for log, _ in self.logs])

    @property
    def events(self):
        return set(self.joined("event_name").tolist())

    @property
    def ended_s(self):
        """Time of the stop request."""
        return {"duration": self.duration_s, "end of the source": WALK.times_s[-1]}[self.report.stopped_by]

    def event_s(self, name):
        return self.joined("event_time_s")[self.joined("event_name") == name]

    @property
    def error_deg(self):
        """Gaze against the true head; the reference neck has both axes and the eye in the origin."""
        pan, tilt = self.joined("joint_position_rad").T
        gaze = np.stack([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), np.sin(tilt)], axis=1)
        head = self.joined("head_true_base_m")
        return np.rad2deg(np.arccos(np.clip(np.sum(gaze * head, axis=1) / np.linalg.norm(head, axis=1), -1, 1)))


def live_setup(neck, robot, source, clock, controller=None, planner=ImmediatePlanner, predictor=None, **more):
    """The parts of a run; `planner` makes the planner of the controller, `more` are further parts."""
    return LiveSetup(
        run_info(neck, mode="live"),
        neck,
        predictor or ConstantVelocity(),
        controller or Mpc(neck, horizon_s=0.3),
        robot,
        source,
        clock,
        make_planner=planner,
        **more,
    )


def run_live(
    change=None,
    on_poll=None,
    on_read=None,
    on_send=None,
    controller=None,
    predictor=None,
    planner=ImmediatePlanner,
    clock=None,
    robot_class=SimulatedNeck,
    start_rad=None,
    walk=WALK,
    duration_s=6.0,
    stop=None,
    keep=None,
    source=None,
    listeners=(),
    neck=NECK,
    **more,
):
    """Run live on a simulated clock, with faults.

    `change(now_s, sighting)`, `on_poll(now_s)`: see `Faulty`; `on_read`, `on_send`: see `Spied`; `planner` makes the
    planner of the controller. An exception that ends the run has the `result` so far.
    """
    clock = clock or SimulatedClock()
    if start_rad is None:
        start_rad = look_at_rad(neck.geometry, walk.truth.head_position_m[0])
    robot = Spied(robot_class(neck, start_rad, clock.now_s), clock, on_read, on_send)
    source = source or Faulty(clock, change, on_poll, walk)
    true_head = TrueHead(walk)
    logs = []

    def known(times_s):
        own_s = times_s - source.start_s
        return np.where(true_head.known(own_s)[:, None], true_head(own_s), np.nan)

    setup = live_setup(neck, robot, source, clock, controller, planner, predictor, true_head_base_m=known, **more)
    run = LiveRun(setup, keep or (lambda log, times: logs.append((log, times))), listeners)
    result = Result(logs, run.report, robot, source, duration_s)
    try:
        run.run(stop or threading.Event(), duration_s)
    except (Exception, KeyboardInterrupt) as error:
        error.result = result
        raise
    finally:
        result.used, result.refused = run.logs.used, run.logs.refused
    return result
