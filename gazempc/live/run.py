"""The loop on a real clock: absolute ticks, observations from a source, a stop within limits."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing, nullcontext
from functools import partial

import numpy as np

from gazempc.errors import GazempcError, RobotError
from gazempc.live.arrivals import Arrivals, ArrivingTarget
from gazempc.live.logs import LiveLogs, LiveReport, LogSink
from gazempc.live.process import real_time_priority
from gazempc.live.robots import ReadAside, first_position_rad, go_in
from gazempc.live.setup import LiveSetup
from gazempc.live.sources.source import Source, SourceError
from gazempc.loop.boundary import PartError, boundary, slow_calls
from gazempc.loop.events import Event
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.loop.looking_away import LookingAway
from gazempc.loop.observer import JointEstimate
from gazempc.loop.pointing import Pointing
from gazempc.loop.smoother import Smoother
from gazempc.loop.track import PersonTrack
from gazempc.loop.trial import warm_up
from gazempc.parts import error_line
from gazempc.people.attention import AttentionState
from gazempc.results.moments import LateMoment, Moment, StatusMoment
from gazempc.robots.robot import Robot
from gazempc.types import FloatArray

# Timeout of the stop within limits.
_STOPPING_S = 5.0
_STILL_RAD_S = 1e-9
# Period of status lines.
_STATUS_PERIOD_S = 0.25

Listener = Callable[[Moment], None]
# Called with the time, seconds, and the state of attention; returns exceptions of earlier reports.
AttentionListener = Callable[[float, AttentionState], Sequence[Exception]]


class LiveRun:
    """One live run: `run`, or `start`, `serve` and `close` in this order.

    The moments of the run are one stream, for logs and listeners.

    Args:
        setup: The parts of the run.
        sink: Called with each complete log, in a separate thread.
        listeners: Called with each moment in the thread of the run; must not block. Removed after an exception.
        attention: Called with the state of attention at each tick; must not block; None for no report.

    Attributes:
        report: Counters of the run.
        logs: Logs of the run.
    """

    def __init__(
        self,
        setup: LiveSetup,
        sink: LogSink,
        listeners: Sequence[Listener] = (),
        attention: AttentionListener | None = None,
    ) -> None:
        self._setup, self._clock, self._neck = setup, setup.clock, setup.neck
        self._listeners, self._attention = tuple(listeners), attention
        self._planner = setup.make_planner(setup.controller)
        self.report = LiveReport()
        self.logs = LiveLogs(setup, sink, self._emit if listeners else None)
        self._arrivals = Arrivals(setup, self.report)
        self._status_due_s = 0.0
        self._target = ArrivingTarget(
            Pointing(setup.several or PersonTrack(setup.predictor, setup.loop), setup.goal), self._arrivals
        )
        self._robot: Robot = setup.robot
        self._smoother: Smoother | None = None
        self._loop: GazeLoop | None = None

    @property
    def joints(self) -> JointEstimate | None:
        """The joints at the last tick; None before the first one."""
        return None if self._loop is None else self._loop.joints

    @property
    def command_rad(self) -> FloatArray:
        """The command at the last tick, shape (N,), radians; the rest angles before the first one."""
        return self._neck.rest_rad if self._smoother is None else self._smoother.command.position_rad

    def run(
        self, stop: threading.Event, duration_s: float | None = None, on_ready: Callable[[], None] | None = None
    ) -> LiveReport:
        """Run until stopped, the source ends or the time is up; then brake the neck and close everything.

        Args:
            stop: Set it to end the run, such as in a signal handler.
            duration_s: Longest time; None for no end.
            on_ready: Called when robot and source are open, before the first tick.

        Returns:
            The report.

        Raises:
            RobotError: If the robot cannot be connected, or its joints cannot be read.
            SourceError: If the source cannot be opened.
            Exception: Any other fault (such as a full disk), after the neck was braked.
        """
        with closing(self):
            if self.start(stop):
                if on_ready is not None:
                    on_ready()
                self.serve(stop, duration_s)
        self.logs.check()
        return self.report

    def start(self, stop: threading.Event) -> bool:
        """Connect the robot, read its joints, open the source.

        Args:
            stop: Ends the start.

        Returns:
            False if it was stopped meanwhile.

        Raises:
            RobotError: If the robot cannot be connected, or its joints cannot be read.
            SourceError: If the source cannot be opened.
        """
        setup = self._setup
        _open("robot: connect()", setup.robot.connect, RobotError)
        start_rad = first_position_rad(setup.robot, setup.neck, setup.clock, stop)
        if start_rad is None:
            self.report.stopped_by = "signal"
            return False
        go_in(setup.robot, setup.neck, setup.clock, start_rad, stop)
        smoother = Smoother(setup.neck, start_rad)
        if setup.clock.is_real and not getattr(setup.robot, "keeps_any_clock", False):
            self._robot = ReadAside(setup.robot)
        target, recorder = self._target, self.logs.recorder
        loop = GazeLoop(setup.neck, target, self._planner, smoother, self._robot, recorder, setup.loop)
        self._arrivals.heads_seen = loop.note_heads
        warm_up(target.predictor, self._planner.controller, setup.neck)
        for source in (setup.source, *setup.more_sources):
            _open("source: open()", source.open, SourceError)
        self._smoother, self._loop = smoother, loop
        return True

    def serve(self, stop: threading.Event, duration_s: float | None = None) -> None:
        """Tick until stopped, the source ends or the time is up; then brake.

        Args:
            stop: Set it to end the run.
            duration_s: Longest time; None for no end.

        Raises:
            Exception: Any fault, after the neck was braked.
        """
        if self._loop is None or self._smoother is None:
            raise RobotError("the run has not been started: call start() first")
        with real_time_priority() if self._clock.is_real else nullcontext():
            self._serve(self._loop, self._smoother, stop, duration_s)

    def _serve(self, loop: GazeLoop, smoother: Smoother, stop: threading.Event, duration_s: float | None) -> None:
        start_s, rate_hz = self._clock.now_s(), self._neck.servo_rate_hz
        self._status_due_s = start_s
        slow_calls(threading.get_ident())  # of an earlier run
        index, stopping_at = 0, None
        failure: BaseException | None = None
        limits = self._neck.command_limits
        # Time to brake from full speed.
        ramp_s = limits.velocity_max_rad_s / limits.acceleration_max_rad_s2
        ramp_s += limits.acceleration_max_rad_s2 / limits.jerk_max_rad_s3
        stopping_s = max(_STOPPING_S, 2.0 * float(np.max(ramp_s)))
        while True:
            due_s = start_s + index * self._neck.servo_period_s
            self._clock.sleep_until_s(due_s)
            now_s = self._clock.now_s()
            late_ms = 1e3 * (now_s - due_s)
            self.report.lateness.add(late_ms)
            # Skip missed ticks: a burst of late commands would have no effect.
            over = int((now_s - due_s) * rate_hz + 1e-6)
            self._emit(LateMoment(late_ms, over))
            self.report.skipped_ticks += over
            index += over
            if stopping_at is None and (why := self._why_stop(stop, now_s, start_s, duration_s)):
                self.report.stopped_by, stopping_at = why, now_s
                self._target.stopped = True
                loop.stop()
            try:
                if failure is None:
                    due_s = start_s + index * self._neck.servo_period_s
                    self._tick(loop, index, now_s, due_s, stopping_at is not None)
                    self._emit_status(loop, smoother, index, now_s)
                else:
                    # The loop has failed: the smoother alone brakes.
                    wanted_rad = smoother.step(now_s, None)
                    speeds = smoother.command.velocity_rad_s
                    self._robot.send_command(np.where(self._neck.speed_joints, speeds, wanted_rad))
            except BaseException as error:
                # Any exception, also an interrupt, is raised after the neck was braked.
                if failure is None:
                    failure, stopping_at = error, now_s
                    self.report.stopped_by = "failure"
                    loop.stop()
            still = bool(np.all(np.abs(smoother.command.velocity_rad_s) < _STILL_RAD_S))
            if stopping_at is not None and (still or now_s - stopping_at > stopping_s):
                break
            index += 1
        self._emit_status(loop, smoother, None, now_s)
        if failure is not None:
            raise failure

    def close(self) -> None:
        """Close source, robot and planner, and keep the last log."""
        setup = self._setup
        with ExitStack() as closing:
            closing.callback(self.logs.close)
            for source in (*setup.more_sources, setup.source):
                closing.callback(self._close, source, source.close, Event.SOURCE_FAILED)
            closing.callback(self._close, self._robot, self._robot.close, Event.ROBOT_NOT_ANSWERING)
            if self._smoother is not None and self._neck.takes_speeds:
                # A velocity-controlled joint holds its last speed, possibly a small output of the position loop.
                standing_rad = np.where(self._neck.speed_joints, 0.0, self.command_rad)
                stop = partial(self._robot.send_command, standing_rad)
                closing.callback(self._close, self._robot, stop, Event.ROBOT_NOT_ANSWERING)
            closing.callback(self._note_slow_calls, ended=True)
            # Closed first, as it uses the source.
            closing.callback(self._planner.close)

    def _close(self, part: Robot | Source, close: Callable[[], object], event: Event) -> None:
        # An exception of `close` must not mask that of the run.
        with boundary(part, "close", lambda error: self.logs.recorder.event(self._clock.now_s(), event, error)):
            close()

    def _note_slow_calls(self, ended: bool = False) -> None:
        if not self._clock.is_real:
            return
        calls = slow_calls(threading.get_ident()) + self._planner.slow_calls(ended)
        if isinstance(self._robot, ReadAside):
            calls += self._robot.slow_calls(ended)
        for error in calls:
            self.logs.recorder.event(self._clock.now_s(), Event.PART_SLOW, error)
        if ended and self._loop is not None:
            self._loop.hand_on()

    def _emit(self, moment: Moment) -> None:
        for listener in self._listeners:
            try:
                with boundary(listener, "__call__"):
                    listener(moment)
            except PartError as error:
                # Remove the listener first: this event is also a moment.
                self._listeners = tuple(each for each in self._listeners if each is not listener)
                self.logs.recorder.event(self._clock.now_s(), Event.LISTENER_FAILED, error)

    def _emit_status(self, loop: GazeLoop, smoother: Smoother, index: int | None, now_s: float) -> None:
        """Emit counts and joints four times a second, between two plans; without an index at once."""
        per_plan = self._neck.servo_ticks_per_plan
        if not self._listeners or (
            index is not None and (now_s < self._status_due_s or index % per_plan != per_plan // 2)
        ):
            return
        # No burst after a pause.
        self._status_due_s = max(self._status_due_s + _STATUS_PERIOD_S, now_s)
        command_rad, seen, plan = smoother.command.position_rad, loop.seen, loop.plan
        self._emit(
            StatusMoment(
                now_s,
                command_rad if loop.joints is None else loop.joints.position_rad,
                command_rad,
                None if seen is None else seen.capture_time_s,
                None if seen is None else seen.head_position_base_m,
                None if plan is None else plan.start_s,
                self.report.observations,
                self.logs.used,
            )
        )

    def _why_stop(self, stop: threading.Event, now_s: float, start_s: float, duration_s: float | None) -> str:
        if stop.is_set():
            return "signal"
        if self._target.finished:
            return "end of the source"
        return "duration" if duration_s is not None and now_s - start_s >= duration_s else ""

    def _tick(self, loop: GazeLoop, index: int, now_s: float, due_s: float, stopping: bool) -> None:
        self.report.ticks += 1
        recorder = self.logs.recorder
        if self._clock.unix_clock_stepped():
            recorder.event(now_s, Event.CLOCK_STEPPED)
        with self._robot.alone() if isinstance(self._robot, ReadAside) else nullcontext():
            self.logs.note_true_joints(now_s)
        self._note_slow_calls()
        loop.tick(index, now_s, [], due_s)
        if loop.joints is not None:
            self._arrivals.note_joints(now_s, loop.joints)
        if self._attention is not None and isinstance(self._setup.several, LookingAway):
            for failure in self._attention(now_s, self._setup.several.state(now_s)):
                recorder.event(now_s, Event.ATTENTION_NOT_SENT, failure)
        if self.logs.due:
            self.logs.cut()
            loop.record_to(self.logs.recorder)
        if not stopping:
            self.logs.check()


def _open(what: str, call: Callable[[], None], refusal: type[GazempcError]) -> None:
    """Open a robot or a source; other exceptions of a user-defined part are converted to `refusal`."""
    try:
        call()
    except (GazempcError, OSError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise refusal(f"{what} raised {error_line(error)}") from error
