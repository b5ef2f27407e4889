"""A loop on a simulated clock with replaceable parts."""

import dataclasses

import numpy as np

from builders.replays import NECK, run_info
from builders.robots import Spied
from gazempc.controllers.lookahead import LookAhead
from gazempc.live.clock import SimulatedClock
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.loop.planner import ImmediatePlanner
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.smoother import Smoother
from gazempc.loop.track import PersonTrack
from gazempc.results.motion import limit_violations
from gazempc.settings import LoopSettings
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import Sighting
from predictors import ConstantVelocity, HeadObservation

TS = NECK.servo_period_s


def ambling_head_m(time_s):
    """A person who ambles to and fro, 2.5 m away."""
    return np.array([2.5, 1.5 * np.sin(0.4 * time_s), 0.4])


def make_recorder(neck=NECK):
    """A recorder for a loop with that neck."""
    return LoopRecorder(neck.control_period_s)


def make_loop(robot, recorder, controller=None, predictor=None, settings=None, neck=NECK):
    """A loop for a neck at rest straight ahead; by default look-ahead and constant velocity."""
    return GazeLoop(
        neck,
        PersonTrack(predictor or ConstantVelocity(), settings or LoopSettings()),
        ImmediatePlanner(controller or LookAhead(neck)),
        Smoother(neck, np.zeros(neck.joints)),
        robot,
        recorder,
        settings or LoopSettings(),
    )


class LoopBench:
    """A loop, its robot and a person observed at 30 Hz; `on_read` and `on_send` as in `Spied`."""

    def __init__(
        self,
        controller=None,
        predictor=None,
        settings=None,
        on_read=None,
        on_send=None,
        robot_neck=NECK,
        head_m=ambling_head_m,
        neck=NECK,
    ):
        self.clock, self.head_m, self.neck = SimulatedClock(), head_m, neck
        if neck is not NECK:
            robot_neck = neck
        start_rad = np.zeros(neck.joints)
        self.robot = Spied(SimulatedNeck(robot_neck, start_rad, self.clock.now_s), self.clock, on_read, on_send)
        self.robot.connect()
        self.recorder = make_recorder(neck)
        self.loop = make_loop(self.robot, self.recorder, controller, predictor, settings, neck)

    def run(self, seconds, seen=lambda t: True, lead_s=0.066, extra=(), answering=True):
        """Run the loop; frames with `seen(capture time)` arrive `lead_s` late, and the `extra` sightings.

        A robot that is not `answering` stops at its command at once, limits or not.
        """
        frames = [k / 30 for k in range(int(seconds * 30)) if seen(k / 30)]
        sightings = [Sighting(t + lead_s, HeadObservation(t, self.head_m(t))) for t in frames]
        sightings = sorted([*sightings, *extra], key=lambda s: s.arrival_s)
        tick_s = self.neck.servo_period_s
        for index in range(int(seconds / tick_s)):
            self.clock.sleep_until_s(index * tick_s)
            now_s = self.clock.now_s()
            due = [s for s in sightings if s.arrival_s <= now_s]
            sightings = sightings[len(due) :]
            self.loop.tick(index, now_s, due)
        log, _ = self.recorder.finish(
            run_info(self.neck),
            lambda t: np.where(t[:, None] <= seconds, np.array([self.head_m(x) for x in t]).reshape(-1, 3), np.nan),
        )
        assert len(log.time_s) == int(seconds / tick_s)
        if answering:
            commands_only = dataclasses.replace(log, joint_position_rad=log.command_position_rad)
            assert limit_violations(commands_only, self.neck) == 0
        return log


def error_deg(log, from_s=0.0):
    """The gaze's error in pan, degrees, at each tick from a time on."""
    pan_rad = np.arctan2(log.head_true_base_m[:, 1], log.head_true_base_m[:, 0])
    return np.rad2deg(np.abs(log.joint_position_rad[:, 0] - pan_rad))[int(from_s / TS) :]


def events(log):
    """The names of a log's events."""
    return set(log.event_name.tolist())
