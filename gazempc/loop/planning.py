"""Schedule of plans: requested one computing delay ahead, and put in force at their first tick."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from functools import partial

import numpy as np

from gazempc.controllers.controller import CommandState, Plan, Situation
from gazempc.loop.boundary import boundary, checked_times
from gazempc.loop.events import Event
from gazempc.loop.observer import JointEstimate
from gazempc.loop.planner import Planner
from gazempc.loop.recorder import LaterRecorder, LoopRecorder
from gazempc.loop.sender import Sender
from gazempc.loop.smoother import Smoother
from gazempc.loop.track import Target
from gazempc.neck.ahead import joints_after_dead_time
from gazempc.neck.spec import NeckSpec
from gazempc.settings import LoopSettings
from gazempc.types import Sighting


class Planning:
    """Requests forecast and plan for the tick at which the plan will be ready.

    Args:
        neck: Model of the neck.
        target: The person to look at.
        planner: Calls predictor and controller.
        smoother: Holds the last command.
        sender: Holds the history of commands.
        settings: Computing delay, and timeout of a track.

    Attributes:
        current: The plan in force; None without one.
    """

    def __init__(
        self,
        neck: NeckSpec,
        target: Target,
        planner: Planner,
        smoother: Smoother,
        sender: Sender,
        settings: LoopSettings,
    ) -> None:
        self._neck, self._target, self._planner = neck, target, planner
        self._smoother, self._sender, self._settings = smoother, sender, settings
        self._delay_ticks = math.ceil(settings.compute_delay_s / neck.servo_period_s - 1e-9)
        self._after_dead_time = joints_after_dead_time(neck, self._delay_ticks)
        self._asked_capture_s = -math.inf
        # The planner may run in another thread.
        self._notes = LaterRecorder()
        # First tick, plan, capture time of its newest observation.
        self._waiting: deque[tuple[int, Plan, float]] = deque()
        self._refused_until = -1
        self.current: Plan | None = None

    def drop(self, until_index: int = -1) -> None:
        """Discard the plan in force, all pending plans, and future answers due up to a tick plus the delay."""
        self.current = None
        self._waiting.clear()
        if until_index >= 0:
            self._refused_until = until_index + self._delay_ticks

    def observe(self, arrived: Iterable[Sighting], time_s: float, recorder: LoopRecorder) -> None:
        """Update the target with observations; see `gazempc.loop.planner.ImmediatePlanner.update`.

        Args:
            arrived: Observations that have arrived.
            time_s: The time, seconds.
            recorder: Receives the records so far.
        """
        self._planner.update(lambda: self._target.assimilate(arrived, time_s, self._notes))
        self.hand_on(recorder)

    def hand_on(self, recorder: LoopRecorder) -> None:
        """Flush the records of target and planner to the recorder."""
        self._notes.hand_on(recorder)

    def ask(
        self,
        index: int,
        time_s: float,
        due_s: float,
        joints: JointEstimate,
        held: tuple[int, ...],
        recorder: LoopRecorder,
    ) -> None:
        """Request a plan for the present forecast.

        Args:
            index: Number of the tick.
            time_s: The time, seconds.
            due_s: Due time of the tick, seconds.
            joints: Estimate of the joints.
            held: Joints that do not follow.
            recorder: Records the reason if no plan is requested.
        """
        period_s = self._neck.servo_period_s
        start_s = due_s + self._delay_ticks * period_s
        committed = [self._committed(index + i, due_s + i * period_s) for i in range(self._delay_ticks)]
        command = committed[-1] if committed else self._smoother.command
        committed_rad = np.array([c.position_rad for c in committed]).reshape(-1, self._neck.joints)
        sent_rad, offset_rad = self._sender.for_controllers(joints.offset_rad)

        def situate() -> Situation | None:
            newest_s = self._target.newest_capture_s
            if newest_s is None:
                self._notes.event(time_s, Event.NO_OBSERVATION_YET)
                return None
            if time_s - newest_s > self._settings.lost_after_s:
                return None
            controller = self._planner.controller
            times_s = np.empty(0)
            with boundary(controller, "forecast_times_s", partial(self._notes.event, time_s, Event.CONTROLLER_FAILED)):
                times_s = checked_times(controller.forecast_times_s(start_s, newest_s), start_s)
            forecast = self._target.forecast(times_s, time_s, self._notes) if times_s.size else None
            if forecast is None:
                return None
            self._asked_capture_s = newest_s
            return Situation(
                self._after_dead_time,
                start_s=start_s,
                forecast=forecast,
                command=command,
                joint_position_rad=joints.position_rad,
                joint_velocity_rad_s=joints.velocity_rad_s,
                joint_offset_rad=offset_rad,
                sent_rad=sent_rad,
                committed_rad=committed_rad,
                held=held,
            )

        if not self._planner.request(index + self._delay_ticks, situate):
            recorder.event(time_s, Event.LATE_PLAN)

    def _committed(self, index: int, time_s: float) -> CommandState:
        # Until the new plan takes effect the smoother follows its predecessor, which may itself be pending.
        plan = next((waiting for due, waiting, _ in reversed(self._waiting) if due <= index), self.current)
        if plan is None or time_s >= plan.end_s:
            return self._smoother.command
        return plan.at(time_s)

    def take_answers(self, index: int, time_s: float, recorder: LoopRecorder) -> None:
        """Queue the plans that the planner has computed, until their first tick.

        Args:
            index: Number of the tick.
            time_s: The time, seconds.
            recorder: Records computing times and events of the plans.
        """
        answers = self._planner.answers()
        self.hand_on(recorder)
        for answer in answers:
            recorder.step(answer.plan_ms)
            if answer.due_index <= self._refused_until:
                continue
            if answer.plan is None:
                recorder.event(time_s, answer.event, answer.error)
                continue
            for event in answer.plan.events:
                recorder.event(time_s, event)
            for fault in answer.plan.faults:
                recorder.event(time_s, fault.event, fault)
            if answer.due_index < index:
                recorder.event(time_s, Event.LATE_PLAN)
            self._waiting.append((answer.due_index, answer.plan, self._asked_capture_s))

    def begin(self, index: int, time_s: float, recorder: LoopRecorder) -> None:
        """Put the plan whose first tick is due in force.

        Args:
            index: Number of the tick.
            time_s: The time, seconds.
            recorder: Records plans that take effect.
        """
        while self._waiting and self._waiting[0][0] <= index:
            _, self.current, capture_s = self._waiting.popleft()
            recorder.begins(time_s, self.current, 1e3 * (time_s - capture_s))
