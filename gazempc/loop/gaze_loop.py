"""The gaze loop: from observations to a command within limits at every tick.

`GazeLoop.tick` executes one servo period, in simulated time (replay) or real time (live run). Fallbacks of the command,
in this order: a fresh plan, the rest of the previous plan, a stop. After `rest_after_s` without the person, the neck
slowly returns to rest. Faults are events of the log (`gazempc.loop.events`). Exceptions of parts are caught and
recorded, with text and first traceback.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from gazempc.controllers.controller import Plan
from gazempc.errors import RobotError
from gazempc.loop.boundary import class_of
from gazempc.loop.events import Event
from gazempc.loop.joints import FollowingWatch, read_joints
from gazempc.loop.observer import JointEstimate, JointObserver
from gazempc.loop.planner import Planner
from gazempc.loop.planning import Planning
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.sender import Sender
from gazempc.loop.smoother import Smoother
from gazempc.loop.track import Target
from gazempc.neck.spec import NeckSpec
from gazempc.robots.robot import Robot
from gazempc.settings import LoopSettings
from gazempc.types import FloatArray, JointState, Sighting
from predictors import HeadObservation

# Two-joint necks are not redundant: no other joint can compensate one that does not follow.
_PAN_AND_TILT = 2
# Maximum time from the connection of a robot to the first tick: readings since then are valid.
_STARTING_S = 1.0


class GazeLoop:
    """Connects target, controller, smoother and robot.

    Args:
        neck: Model of the neck.
        target: The person to look at.
        planner: Calls the controller for plans.
        smoother: Converts plans to commands; holds the last command.
        robot: Executes the commands; connected.
        recorder: Records the run.
        settings: Timeouts of observations, plans and tracks.
    """

    def __init__(
        self,
        neck: NeckSpec,
        target: Target,
        planner: Planner,
        smoother: Smoother,
        robot: Robot,
        recorder: LoopRecorder,
        settings: LoopSettings,
    ) -> None:
        self._neck, self._target, self._smoother = neck, target, smoother
        self._robot, self._recorder, self._settings = robot, recorder, settings
        self._sender = Sender(neck, robot, smoother)
        self._planning = Planning(neck, target, planner, smoother, self._sender, settings)
        self._observer: JointObserver | None = None
        self._following = FollowingWatch(neck)
        self._last_index: int | None = None
        self._stopping = False
        self._began_s = self._near_until_s = -math.inf
        self._rest_plan = _standing(neck.rest_rad)

    @property
    def joints(self) -> JointEstimate | None:
        """Estimate of the joints at the last tick; None before the first one."""
        return None if self._observer is None else self._observer.estimate

    @property
    def seen(self) -> HeadObservation | None:
        """The newest observation passed to the predictor, also if its gate rejected it; None before the first one."""
        return self._target.newest

    @property
    def plan(self) -> Plan | None:
        """The plan in force; None without one."""
        return self._planning.current

    def tick(self, index: int, time_s: float, arrived: Iterable[Sighting], due_s: float | None = None) -> None:
        """Execute one servo period.

        Args:
            index: Number of the tick, strictly increasing; gaps are skipped ticks. Every
                `NeckSpec.servo_ticks_per_plan`-th tick plans.
            time_s: The time, seconds.
            arrived: Observations that have arrived since the last tick.
            due_s: Nominal time of a late tick, for which commands are computed, to avoid jitter.
        """
        due_s = time_s if due_s is None else due_s
        recorder, planning = self._recorder, self._planning
        per_plan = self._neck.servo_ticks_per_plan
        plans = self._last_index is None or index // per_plan != self._last_index // per_plan
        if self._last_index is not None:
            for skipped_rad in self._sender.skip(index - self._last_index - 1):
                self._following.sent(skipped_rad)
        self._last_index = index
        arrived = list(arrived)
        self.note_heads(arrived, time_s)
        planning.observe(arrived, time_s, recorder)
        measured = read_joints(self._robot, self._neck, time_s, recorder)
        if self._observer is None:
            self._observer = JointObserver(self._neck, self._smoother.command.position_rad, time_s)
            self._began_s = time_s
        held = self._watch_joints(time_s, measured, plans)
        self._observer.update(time_s, measured, held)
        # Readings from the time between connection and first tick are valid.
        since_s = self._began_s - _STARTING_S
        if self._observer.refused and measured is not None and not since_s < measured.time_s < self._began_s:
            stands = f"read_state() returned {measured.position_rad.tolist()} rad at {measured.time_s:.3f} s"
            self._blame(time_s, Event.JOINT_READING_REFUSED, stands)
        if off := self._observer.off_command:
            self._blame(time_s, Event.JOINT_OFF_COMMAND, f"{self._names(off)} 10 degrees or more off")
        if not self._stopping:
            # Also before the request: the planner is free after its answer is taken.
            planning.take_answers(index, time_s, recorder)
            if plans and not self._sender.silent:
                planning.ask(index, time_s, due_s, self._observer.estimate, held, recorder)
                planning.take_answers(index, time_s, recorder)
            planning.begin(index, time_s, recorder)
        wanted_rad = self._next_command(time_s, due_s)
        sent_rad = self._sender.send(wanted_rad, self._observer, time_s, recorder, self._near_limit_rad_s(time_s))
        if self._sender.silent:
            # Pending plans start from an unacknowledged command.
            planning.drop(index)
        self._observer.sent(self._sender.sent)
        self._following.sent(sent_rad)
        recorder.tick(time_s, measured, sent_rad, self._smoother.motions)

    def record_to(self, recorder: LoopRecorder) -> None:
        """Replace the recorder."""
        self._recorder = recorder

    def hand_on(self) -> None:
        """Flush the records of target and planner since the last tick."""
        self._planning.hand_on(self._recorder)

    def note_heads(self, sightings: Iterable[Sighting], time_s: float) -> None:
        """Limit the speed of the commands while a head is near (`LoopSettings.near_speed_max`).

        All detections count, also unattended or refused ones: this limit is independent of tracking.

        Args:
            sightings: Detected heads; may come from another thread.
            time_s: The time, seconds.
        """
        if self._settings.near_speed_max is None:
            return
        for sighting in sightings:
            x_m, y_m, _ = sighting.observation.head_position_base_m
            if math.hypot(x_m, y_m) < self._settings.near_speed_max[0]:
                self._near_until_s = time_s + self._settings.lost_after_s

    def stop(self) -> None:
        """End planning: the following ticks stop the command."""
        self._stopping = True
        self._planning.drop()

    def _watch_joints(self, time_s: float, measured: JointState | None, judges: bool) -> tuple[int, ...]:
        # Joints that do not follow; judged at the control rate.
        following = self._following
        following.measured(measured)
        if judges:
            following.judge()
            if held := following.held:
                self._blame(
                    time_s, Event.JOINT_NOT_FOLLOWING, f"{self._names(held)} stands still although its commands move"
                )
        return following.held if self._neck.joints > _PAN_AND_TILT else ()

    def _names(self, joints: Iterable[int]) -> str:
        return "joint " + ", ".join(self._neck.joint_names[joint] for joint in joints)

    def _blame(self, time_s: float, event: Event, text: str) -> None:
        self._recorder.event(time_s, event, RobotError(f"{text} ({class_of(self._robot)})"))

    def _next_command(self, time_s: float, due_s: float) -> FloatArray:
        if self._stopping:
            return self._smoother.step(due_s, None)
        speed_limit_rad_s = self._near_limit_rad_s(time_s)
        rest_speed_rad_s = min(self._settings.rest_speed_rad_s, speed_limit_rad_s)
        if self._sender.silent:
            # Return to the last acknowledged angles at rest speed: no command step when the connection is back.
            return self._smoother.step(due_s, _standing(self._sender.acknowledged_rad), rest_speed_rad_s)
        newest_s = self._target.newest_capture_s
        unseen_s = 0.0 if newest_s is None else time_s - newest_s
        if unseen_s > self._settings.rest_after_s:
            self._planning.current = None
            self._recorder.event(time_s, Event.RETURN_TO_REST)
            return self._smoother.step(due_s, self._rest_plan, rest_speed_rad_s)
        if unseen_s > self._settings.lost_after_s:
            self._planning.current = None
            self._recorder.event(time_s, Event.TARGET_LOST)
        wanted_rad = self._smoother.step(due_s, self.plan, speed_limit_rad_s)
        if self._smoother.intervention and self.plan is not None:
            self._recorder.event(time_s, self._smoother.intervention)
        return wanted_rad

    def _near_limit_rad_s(self, time_s: float) -> float:
        near = self._settings.near_speed_max
        return math.inf if near is None or time_s > self._near_until_s else near[1]


def _standing(position_rad: FloatArray) -> Plan:
    return Plan(0.0, np.inf, position_rad[None], *np.zeros((2, 1, position_rad.size)))
