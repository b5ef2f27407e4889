"""The gaze loop joins all stages: observations in, and a command within limits out at every tick.

One call of `GazeLoop.tick` is one servo period. A replay calls it in simulated time, a live run in real time. The
command follows the first of these that exists: a fresh plan, the rest of the last plan, a stop. After `rest_after_s`
without the person, the neck slowly returns to rest. Unusual things are events of the log (`gazempc.loop.events`). The
loop survives an exception of a part, and gives its text and first traceback to the recorder.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterable

import numpy as np

from gazempc.controllers.controller import AxisMotion, CommandState, ControllerError, Plan, Situation
from gazempc.errors import RobotError
from gazempc.loop.drive import Drive
from gazempc.loop.events import Event
from gazempc.loop.following import FollowingWatch
from gazempc.loop.joint_reading import read_joints
from gazempc.loop.observer import JointEstimate, JointObserver
from gazempc.loop.planner import Answer, Planner
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.smoother import Smoother
from gazempc.loop.track import PersonTrack, Target
from gazempc.neck.ahead import settled_joints
from gazempc.neck.spec import NeckSpec
from gazempc.robots.robot import Robot
from gazempc.settings import LoopSettings
from gazempc.types import FloatArray, JointState, Sighting
from predictors import Forecast, HeadObservation

# So many commands in a row may get lost before the motion starts again from rest: on a busy line single ones do.
_SENDS_FORGIVEN = 2
_PAN_AND_TILT = 2


class GazeLoop:
    """Joins target, controller, smoother and robot.

    Args:
        neck: The neck as the controller knows it.
        target: Whom to look at.
        planner: Asks the controller for plans.
        smoother: Makes commands of plans; it holds where the command stands.
        robot: Executes the commands; connected.
        recorder: Records what happens.
        settings: When to give up on something.
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
        self._neck = neck
        self._ticks_per_plan = neck.servo_ticks_per_plan
        self._target = target
        self._planner = planner
        self._controller = planner.controller
        self._smoother = smoother
        self._robot = robot
        self._recorder = recorder
        self._settings = settings
        self._delay_ticks = math.ceil(settings.compute_delay_s / neck.servo_period_s - 1e-9)
        self._settled = settled_joints(neck, self._delay_ticks)
        history = int(np.ceil(float(np.max(neck.dead_time_s)) / neck.servo_period_s)) + 2
        start_rad = smoother.command.position_rad
        self._sent_rad: FloatArray = np.tile(start_rad, (history, 1))
        self._drive = Drive(neck, start_rad)
        # What the robot goes by until something else gets through.
        self._acts: FloatArray = np.array(
            [0.0 if axis.takes_speed else at for axis, at in zip(neck.axes, start_rad, strict=True)]
        )
        self._observer: JointObserver | None = None
        # Pan and tilt alone have nobody who could take over.
        self._following = FollowingWatch(neck) if neck.joints > _PAN_AND_TILT else None
        self._forecast_ms = 0.0
        self._last_index: int | None = None
        self._ignored_until = -1
        self._stopping = False
        self._gets_through = True
        self._failed_sends = 0
        self._plan: Plan | None = None
        self._waiting: deque[tuple[int, Plan, float]] = deque()
        self._asked_capture_s = -math.inf
        self._rest_plan = Plan(0.0, np.inf, neck.rest_rad[None], np.zeros((1, neck.joints)), np.zeros((1, neck.joints)))

    @property
    def joints(self) -> JointEstimate | None:
        """Where the joints were at the last tick, as estimated; None before the first one."""
        return None if self._observer is None or self._last_index is None else self._observer.estimate

    @property
    def seen(self) -> HeadObservation | None:
        """The newest observation that was used; None before the first one."""
        return self._target.newest

    @property
    def plan(self) -> Plan | None:
        """The plan that commands are made by now; None without one."""
        return self._plan

    def tick(self, index: int, time_s: float, arrived: Iterable[Sighting], due_s: float | None = None) -> None:
        """Do all that is due in one servo period.

        Args:
            index: Number of the tick, larger than the last number; by more than 1 if ticks were skipped. Every
                `NeckSpec.servo_ticks_per_plan`-th tick plans.
            time_s: The time, seconds.
            arrived: Observations that have arrived since the last tick.
            due_s: Due time of a tick that is a little late. Commands are made for this time, so they do not jitter.
        """
        due_s = time_s if due_s is None else due_s
        per_plan = self._ticks_per_plan
        plans = self._last_index is None or index // per_plan != self._last_index // per_plan
        left_out = 0 if self._last_index is None else index - self._last_index - 1
        for _ in range(min(left_out, len(self._sent_rad))):
            self._note_sent(self._drive.sent(self._acts, got_through=False).copy())
        self._last_index = index
        self._target.take_in(arrived, time_s, self._recorder)
        measured = read_joints(self._robot, self._neck.joints, time_s, self._recorder)
        if self._observer is None:
            self._observer = JointObserver(self._neck, self._smoother.command.position_rad, time_s)
        held = self._watch_joints(time_s, measured, plans)
        self._observer.update(time_s, measured, held)
        if self._observer.refused:
            self._recorder.event(time_s, Event.JOINT_READING_REFUSED)
        # Before asking, too: a planner that has answered is free again.
        self._take_answers(index, time_s)
        if plans and self._gets_through and not self._stopping:
            self._ask_for_plan(index, time_s, due_s, self._observer.estimate, held)
            self._take_answers(index, time_s)
        while self._waiting and self._waiting[0][0] <= index:
            _, self._plan, capture_s = self._waiting.popleft()
            self._recorder.begins(time_s, self._plan, 1e3 * (time_s - capture_s))
        before = self._smoother.motions
        wanted_rad = self._next_command(time_s, due_s)
        if self._neck.takes_speeds:
            wanted_rad = self._drive.outgoing(self._smoother.motions, self._offset_rad())
        self._send(wanted_rad, before, index, time_s)
        self._observer.sent(self._acts)
        sent_rad = self._drive.sent(self._acts, self._gets_through)
        self._note_sent(sent_rad)
        self._recorder.tick(time_s, measured, sent_rad, self._smoother.motions)

    def prepare(self, time_s: float) -> None:
        """Build now what else the first ticks would wait for; predictor and controller are reset.

        What they raise is survived, as in a tick.

        Args:
            time_s: The time, seconds.
        """
        self._observer = JointObserver(self._neck, self._smoother.command.position_rad, time_s)
        # Somebody passes so near that limits bind: then the solver is needed, too.
        seen_s = [time_s + i / 30.0 for i in range(5)]
        start_s = time_s + self._delay_ticks * self._neck.servo_period_s
        failed, predictor = Event.FORECAST_FAILED, self._target.predictor
        try:
            for i, each_s in enumerate(seen_s):
                predictor.update(HeadObservation(each_s, np.array([0.8, 0.1 * i, 0.3])))
            failed = Event.CONTROLLER_FAILED
            times_s = np.asarray(self._controller.forecast_times_s(start_s, seen_s[-1]), dtype=np.float64)
            forecast = PersonTrack(predictor, self._settings).forecast(times_s, time_s, self._recorder)
            if forecast is not None:
                self._controller.plan(self._at_rest(start_s, forecast))
        except ControllerError:
            pass  # nobody waits for this plan
        except Exception as error:
            self._recorder.event(time_s, failed, error)
        predictor.reset()
        self._controller.reset()

    def _at_rest(self, start_s: float, forecast: Forecast) -> Situation:
        command = self._smoother.command
        return Situation.of(
            self._settled,
            start_s=start_s,
            forecast=forecast,
            command=command,
            joint_position_rad=command.position_rad,
            joint_velocity_rad_s=np.zeros(self._neck.joints),
            joint_offset_rad=np.zeros(self._neck.joints),
            sent_rad=self._sent_rad.copy(),
            committed_rad=np.tile(command.position_rad, (self._delay_ticks, 1)),
        )

    def record_to(self, recorder: LoopRecorder) -> None:
        """Record to another recorder from now on.

        Args:
            recorder: The recorder.
        """
        self._recorder = recorder

    def stop(self) -> None:
        """Give up planning: the following ticks stop the command."""
        self._stopping = True
        self._plan = None
        self._waiting.clear()

    def _offset_rad(self) -> FloatArray:
        return np.zeros(self._neck.joints) if self._observer is None else self._observer.estimate.offset_rad

    def _watch_joints(self, time_s: float, measured: JointState | None, judges: bool) -> tuple[int, ...]:
        # Joints that do not follow; this is judged as often as plans are made.
        following = self._following
        if following is None:
            return ()
        following.measured(measured)
        if judges:
            for joint in following.judge():
                name = self._neck.joint_names[joint]
                error = RobotError(f"joint {name} stands still although its commands move")
                self._recorder.event(time_s, Event.JOINT_NOT_FOLLOWING, error)
            if following.held:
                self._recorder.event(time_s, Event.JOINT_NOT_FOLLOWING)
        return following.held

    def _note_sent(self, sent_rad: FloatArray) -> None:
        if self._following is not None:
            self._following.sent(sent_rad)
        self._sent_rad[:-1] = self._sent_rad[1:]
        self._sent_rad[-1] = sent_rad

    def _ask_for_plan(
        self, index: int, time_s: float, due_s: float, joints: JointEstimate, held: tuple[int, ...]
    ) -> None:
        newest_s = self._target.newest_capture_s
        if newest_s is None:
            self._recorder.event(time_s, Event.NO_OBSERVATION_YET)
            return
        if time_s - newest_s > self._settings.lost_after_s:
            return
        started = time.perf_counter()
        start_s = due_s + self._delay_ticks * self._neck.servo_period_s
        try:
            times_s = np.asarray(self._controller.forecast_times_s(start_s, newest_s), dtype=np.float64)
        except Exception as error:
            self._recorder.event(time_s, Event.CONTROLLER_FAILED, error)
            return
        forecast = self._target.forecast(times_s, time_s, self._recorder)
        if forecast is None:
            return
        committed = [
            self._committed(index + i, due_s + i * self._neck.servo_period_s) for i in range(self._delay_ticks)
        ]
        # A copy, as a planner in the background reads it later.
        sent_rad, offset_rad = self._drive.seen_by_controllers(self._sent_rad, joints.offset_rad)
        situation = Situation.of(
            self._settled,
            start_s=start_s,
            forecast=forecast,
            command=committed[-1] if committed else self._smoother.command,
            joint_position_rad=joints.position_rad,
            joint_velocity_rad_s=joints.velocity_rad_s,
            joint_offset_rad=offset_rad,
            sent_rad=sent_rad,
            committed_rad=np.array([c.position_rad for c in committed]).reshape(-1, self._neck.joints),
            held=held,
        )
        self._forecast_ms = 1e3 * (time.perf_counter() - started)
        if self._planner.request(index + self._delay_ticks, situation):
            self._asked_capture_s = newest_s
        else:
            self._recorder.event(time_s, Event.LATE_PLAN)

    def _take_answers(self, index: int, time_s: float) -> None:
        for answer in () if self._stopping else self._planner.answers():
            self._take_answer(answer, index, time_s)

    def _take_answer(self, answer: Answer, index: int, time_s: float) -> None:
        self._recorder.step(self._forecast_ms + answer.plan_ms)
        if answer.due_index <= self._ignored_until:
            return
        if answer.plan is None:
            self._recorder.event(time_s, answer.event, answer.error)
            return
        for event in answer.plan.events:
            self._recorder.event(time_s, event)
        for fault in answer.plan.faults:
            self._recorder.event(time_s, fault.event, fault)
        if answer.due_index < index:
            self._recorder.event(time_s, Event.LATE_PLAN)
        self._waiting.append((answer.due_index, answer.plan, self._asked_capture_s))

    def _committed(self, index: int, time_s: float) -> CommandState:
        # Until a plan takes effect the smoother follows the one before it, which may itself be waiting still.
        plan = next((waiting for due, waiting, _ in reversed(self._waiting) if due <= index), self._plan)
        if plan is None or time_s >= plan.end_s:
            return self._smoother.command
        return plan.at(time_s)

    def _next_command(self, time_s: float, due_s: float) -> FloatArray:
        if self._stopping:
            return self._smoother.step(due_s, None)
        newest_s = self._target.newest_capture_s
        unseen_s = 0.0 if newest_s is None else time_s - newest_s
        if unseen_s > self._settings.rest_after_s:
            self._plan = None
            self._recorder.event(time_s, Event.RETURN_TO_REST)
            return self._smoother.step(due_s, self._rest_plan, self._settings.rest_speed_rad_s)
        if unseen_s > self._settings.lost_after_s:
            self._plan = None
            self._recorder.event(time_s, Event.TARGET_LOST)
        wanted_rad = self._smoother.step(due_s, self._plan)
        if self._smoother.intervention and self._plan is not None:
            self._recorder.event(time_s, self._smoother.intervention)
        return wanted_rad

    def _send(self, wanted: FloatArray, before: tuple[AxisMotion, ...], index: int, time_s: float) -> None:
        try:
            sent: FloatArray = np.array(self._robot.send_command(wanted), dtype=np.float64)
            if sent.shape != wanted.shape or not all(map(math.isfinite, sent.tolist())):
                raise ValueError(f"send_command() returned {sent!r}, needed are {len(wanted)} finite angles in radians")
        except Exception as error:
            self._recorder.event(time_s, Event.ROBOT_NOT_ANSWERING, error)
        else:
            self._gets_through, self._failed_sends = True, 0
            self._acts = sent
            return
        self._gets_through = False
        self._failed_sends += 1
        if self._failed_sends <= _SENDS_FORGIVEN:
            # One lost command is no reason to stop dead: the same motion goes on from where it was.
            self._smoother.resume(before)
            return
        # The robot stands by what it got last. The command starts again from there: had it moved on meanwhile, the
        # first one to get through would be a jump.
        self._smoother.reset(self._drive.restart(self._acts, self._offset_rad()))
        self._plan = None
        self._waiting.clear()
        # What is asked for already starts from commands that did not get through.
        self._ignored_until = index + self._delay_ticks
