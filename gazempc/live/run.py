"""The loop on a real clock: absolute ticks, observations from a source, a stop that stops."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import ExitStack, nullcontext

import numpy as np

from gazempc.errors import RobotError
from gazempc.live.arrivals import Arrivals
from gazempc.live.clock import RealClock
from gazempc.live.logs import LiveLogs
from gazempc.live.parts import Keeping, LiveParts
from gazempc.live.process import in_front
from gazempc.live.report import LiveReport
from gazempc.live.sources.source import SourceError
from gazempc.live.start import first_position_rad, go_in, opened
from gazempc.live.status_maker import StatusMaker
from gazempc.loop.events import Event
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.loop.looking_away import LookingAway
from gazempc.loop.observer import JointEstimate
from gazempc.loop.smoother import Smoother
from gazempc.loop.trial import warm_up
from gazempc.neck.spec import NeckSpec
from gazempc.results.moments import LateMoment

# A command that moves stops within limits long before.
_STOPPING_S = 5.0
_STILL_RAD_S = 1e-9


class LiveRun:
    """One live run: `run`, or `start`, `serve` and `close` one after the other.

    Args:
        parts: What it joins.
        keeping: What its logs say, and who takes them.

    Attributes:
        report: What it is like so far.
        logs: Its logs.
    """

    def __init__(self, parts: LiveParts, keeping: Keeping) -> None:
        self._parts, self._clock, self._neck = parts, parts.clock, parts.neck
        self.report = LiveReport()
        self.logs = LiveLogs(parts, keeping)
        self._watch = keeping.watch
        self._arrivals = Arrivals(parts, self.report)
        self._show, self._tell = keeping.show, keeping.tell
        self._statuses: StatusMaker | None = None
        self._smoother: Smoother | None = None
        self._loop: GazeLoop | None = None

    @property
    def joints(self) -> JointEstimate | None:
        """Where the joints were at the last tick; None before the first one."""
        return None if self._loop is None else self._loop.joints

    def run(
        self, stop: threading.Event, duration_s: float | None = None, on_ready: Callable[[], None] | None = None
    ) -> LiveReport:
        """Run until told to stop, the source ends or the time is up; then stop the neck and close everything.

        Args:
            stop: Set it to end the run, from a signal handler say.
            duration_s: Longest time; None for no end.
            on_ready: Called when robot and source are open, before the first tick.

        Returns:
            The report.

        Raises:
            RobotError: If the robot cannot be connected to, or does not say where it stands.
            SourceError: If the source cannot be opened.
            Exception: Whatever else came up (a full disk, say), after the neck was braked.
        """
        try:
            if self.start(stop):
                if on_ready is not None:
                    on_ready()
                self.serve(stop, duration_s)
        finally:
            self.close()
        self.logs.check()
        return self.report

    def start(self, stop: threading.Event) -> bool:
        """Connect the robot, read its joints, open the source.

        Args:
            stop: Ends the start.

        Returns:
            False if told to stop meanwhile.

        Raises:
            RobotError: If the robot cannot be connected to, or does not say where it stands.
            SourceError: If the source cannot be opened.
        """
        parts = self._parts
        opened("robot: connect()", parts.robot.connect, RobotError)
        start_rad = first_position_rad(parts, stop)
        if start_rad is None:
            self.report.stopped_by = "signal"
            return False
        go_in(parts, start_rad, stop)
        smoother = Smoother(parts.neck, start_rad)
        target = parts.target()
        loop = GazeLoop(parts.neck, target, parts.planner, smoother, parts.robot, self.logs.recorder, parts.settings)
        warm_up(target.predictor, parts.planner.controller, parts.neck)
        opened("source: open()", parts.source.open, SourceError)
        if parts.telling is not None:
            parts.telling.open()
        self._smoother, self._loop = smoother, loop
        if self._show is not None:
            self._statuses = StatusMaker(parts, loop, smoother, self.report, self.logs, self._show)
        return True

    def serve(self, stop: threading.Event, duration_s: float | None = None) -> None:
        """Tick until told to stop, the source ends or the time is up; then brake.

        Args:
            stop: Set it to end the run.
            duration_s: Longest time; None for no end.

        Raises:
            Exception: Whatever came up, after the neck was braked.
        """
        if self._loop is None or self._smoother is None:
            raise RobotError("the run has not been started: call start() first")
        with in_front() if isinstance(self._clock, RealClock) else nullcontext():
            self._serve(self._loop, self._smoother, stop, duration_s)

    def _serve(self, loop: GazeLoop, smoother: Smoother, stop: threading.Event, duration_s: float | None) -> None:
        start_s, rate_hz = self._clock.now_s(), self._neck.servo_rate_hz
        index, stopping_at = 0, None
        failure: BaseException | None = None
        stopping_s = max(_STOPPING_S, 2.0 * _ramp_s(self._neck))
        while True:
            due_s = start_s + index * self._neck.servo_period_s
            self._clock.sleep_until_s(due_s)
            now_s = self._clock.now_s()
            self.report.lateness.add(1e3 * (now_s - due_s))
            if self._statuses is not None:
                self._statuses.late(now_s - due_s)
            # Ticks that are over by now are left out: a burst of commands would help nobody.
            over = int((now_s - due_s) * rate_hz + 1e-6)
            if self._watch is not None:
                self._watch(LateMoment(1e3 * (now_s - due_s), over))
            self.report.skipped_ticks += over
            index += over
            if stopping_at is None and (why := self._why_stop(stop, now_s, start_s, duration_s)):
                self.report.stopped_by, stopping_at = why, now_s
                loop.stop()
            try:
                if failure is None:
                    due_s = start_s + index * self._neck.servo_period_s
                    self._tick(loop, index, now_s, due_s, stopping_at is not None)
                else:
                    # Not even the loop can be relied on any more.
                    self._parts.robot.send_command(smoother.step(now_s, None))
            except BaseException as error:
                # Whatever it was, an interrupt, too: the neck is braked before it is told.
                if failure is None:
                    failure, stopping_at = error, now_s
                    self.report.stopped_by = "failure"
                    loop.stop()
            still = bool(np.all(np.abs(smoother.command.velocity_rad_s) < _STILL_RAD_S))
            if stopping_at is not None and (still or now_s - stopping_at > stopping_s):
                break
            index += 1
        if self._statuses is not None:
            self._statuses.finish(now_s)
        if failure is not None:
            raise failure

    def close(self) -> None:
        """Close source, robot and planner, and keep the last log."""
        with ExitStack() as closing:
            closing.callback(self.logs.close)
            closing.callback(self._parts.planner.close)
            closing.callback(self._close, self._parts.robot.close, Event.ROBOT_NOT_ANSWERING)
            closing.callback(self._close, self._parts.source.close, Event.SOURCE_FAILED)
            if self._parts.telling is not None:
                closing.callback(self._parts.telling.close)

    def _close(self, close: Callable[[], None], event: Event) -> None:
        # It promises not to raise; what it raises all the same must not hide how the run ended.
        try:
            close()
        except Exception as error:
            self.logs.recorder.event(self._clock.now_s(), event, error)

    def _why_stop(self, stop: threading.Event, now_s: float, start_s: float, duration_s: float | None) -> str:
        if stop.is_set():
            return "signal"
        if self._arrivals.finished(now_s, self.logs.recorder):
            return "end of the source"
        return "duration" if duration_s is not None and now_s - start_s >= duration_s else ""

    def _tick(self, loop: GazeLoop, index: int, now_s: float, due_s: float, stopping: bool) -> None:
        self.report.ticks += 1
        recorder = self.logs.recorder
        if isinstance(self._clock, RealClock) and self._clock.unix_clock_stepped():
            recorder.event(now_s, Event.CLOCK_STEPPED)
        self.logs.note_true_joints()
        loop.tick(index, now_s, [] if stopping else self._arrivals.take(now_s, recorder), due_s)
        if loop.joints is not None:
            self._arrivals.note_joints(now_s, loop.joints)
        if self._statuses is not None:
            self._statuses.after_tick(index, now_s)
        if self._tell is not None and isinstance(self._parts.several, LookingAway):
            for failure in self._tell(now_s, self._parts.several.state(now_s)):
                recorder.event(now_s, Event.ATTENTION_NOT_SENT, failure)
        if self.logs.due:
            self.logs.cut()
            loop.record_to(self.logs.recorder)
        if not stopping:
            self.logs.check()


def _ramp_s(neck: NeckSpec) -> float:
    """How long it takes to brake from full speed, seconds."""
    limits = neck.command_limits
    ramp_s = limits.velocity_max_rad_s / limits.acceleration_max_rad_s2
    ramp_s += limits.acceleration_max_rad_s2 / limits.jerk_max_rad_s3
    return float(np.max(ramp_s))
