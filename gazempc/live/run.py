"""The loop on a real clock: absolute ticks, observations from a source, a stop that stops."""

from __future__ import annotations

import gc
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np

from gazempc.errors import RobotError
from gazempc.live.clock import Clock, RealClock
from gazempc.live.lateness import Lateness
from gazempc.live.mount import JointHistory, Mount
from gazempc.live.sources.source import Source
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.loop.planner import Planner
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.smoother import Smoother
from gazempc.neck.spec import NeckSpec
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.run_info import RunInfo
from gazempc.robots.robot import Robot
from gazempc.robots.start import way_in_rad
from gazempc.settings import LoopSettings
from gazempc.types import FloatArray, JointState, Sighting
from predictors import HeadObservation, Predictor

# For so long the joints are asked for before the first command.
_FIRST_READING_S = 1.0
# A command that moves stops within limits long before.
_STOPPING_S = 5.0
_STILL_RAD_S = 1e-9
_PROBLEMS_KEPT = 20
_NEWEST = 16


@dataclass
class LiveReport:
    """What a live run was like; grows with the number of kinds of trouble only, not with time.

    Attributes:
        ticks: Number of ticks done.
        skipped_ticks: Ticks left out, as the one before took too long.
        lateness: How much later than due the ticks began.
        observations: Number of observations that arrived.
        problems: What arrived and could not be used, the first 20.
        n_problems: How many there were.
        stopped_by: Why the run ended.
    """

    ticks: int = 0
    skipped_ticks: int = 0
    lateness: Lateness = field(default_factory=Lateness)
    observations: int = 0
    problems: list[str] = field(default_factory=list)
    n_problems: int = 0
    stopped_by: str = ""


Keep = Callable[[Log, ComputeTimes], None]


class LiveRun:
    """One live run.

    Args:
        neck: The neck as the controller knows it.
        predictor: Forecasts the head.
        planner: Asks the controller for plans.
        robot: Executes commands; not yet connected.
        source: Where observations come from; not yet open.
        mount: Where the sensor is.
        clock: The clock of all of these.
        settings: When the loop gives up on something.
        about: Description of the run, for the log.
        keep: Takes each log, of `log_s` seconds, as soon as it is complete.
        log_s: Length of a log, seconds.
        true_head_base_m: True head positions, shape (H, 3), at times, shape (H,), where they are known.
        true_state: Where the joints really are, for a simulated robot.
    """

    def __init__(
        self,
        neck: NeckSpec,
        predictor: Predictor,
        planner: Planner,
        robot: Robot,
        source: Source,
        mount: Mount,
        clock: Clock,
        settings: LoopSettings,
        about: RunInfo,
        keep: Keep,
        log_s: float = 300.0,
        true_head_base_m: Callable[[FloatArray], FloatArray] | None = None,
        true_state: Callable[[], JointState] | None = None,
    ) -> None:
        self._neck, self._robot, self._source = neck, robot, source
        self._predictor, self._planner = predictor, planner
        self._mount, self._clock, self._settings = mount, clock, settings
        self._about, self._keep = about, keep
        self._log_ticks = max(1, round(log_s * neck.servo_rate_hz))
        self._true_head, self._true_state = true_head_base_m or _unknown, true_state
        self._joints = JointHistory()
        self._recorder = LoopRecorder(neck.control_period_s)
        self._true_joints: list[JointState | None] = []
        self._writer = ThreadPoolExecutor(1, "log")
        self._written: deque[Future[None]] = deque()
        self.report = LiveReport()

    def run(self, stop: threading.Event, duration_s: float | None = None) -> LiveReport:
        """Run until told to stop, the source ends or the time is up; then stop the neck and close everything.

        Args:
            stop: Set it to end the run, from a signal handler say.
            duration_s: Longest time; None for no end.

        Returns:
            The report.

        Raises:
            RobotError: If the robot cannot be connected to, or does not say where it stands.
            SourceError: If the source cannot be opened.
            Exception: Whatever else came up (a full disk, say), after the neck was braked.
        """
        with ExitStack() as closing:
            closing.callback(self._writer.shutdown)
            closing.callback(self._keep_log)
            closing.callback(self._planner.close)
            closing.callback(self._robot.close)
            closing.callback(self._source.close)
            self._robot.connect()
            start_rad = self._first_position_rad(stop)
            if start_rad is None:
                self.report.stopped_by = "signal"
                return self.report
            self._go_in(start_rad, stop)
            smoother = Smoother(self._neck, start_rad)
            loop = GazeLoop(
                self._neck,
                self._predictor,
                self._planner,
                smoother,
                self._robot,
                self._recorder,
                self._settings,
            )
            loop.prepare(self._clock.now_s())
            # What is there now stays; looking through it for garbage would take many ticks' time, and what comes is
            # given back by its references.
            gc.collect()
            gc.freeze()
            gc.disable()
            closing.callback(gc.enable)
            closing.callback(gc.unfreeze)
            self._source.open()
            self._tick_until_stopped(loop, smoother, stop, duration_s)
        self._raise_if_not_kept()
        return self.report

    def _first_position_rad(self, stop: threading.Event) -> FloatArray | None:
        """Where the joints stand: a command that began elsewhere would jump. None if told to stop before that is known.

        Raises:
            RobotError: If it does not become known.
        """
        if not self._neck.reports_joints:
            return self._neck.rest_rad
        until_s = self._clock.now_s() + _FIRST_READING_S
        problem = "there is no reading"
        while not stop.is_set():
            try:
                state = self._robot.read_state()
                if state is not None and state.position_rad.shape == (2,) and np.all(np.isfinite(state.position_rad)):
                    return state.position_rad
            except Exception as error:
                problem = str(error) or type(error).__name__
            if self._clock.now_s() >= until_s:
                raise RobotError(
                    f"the joints cannot be read ({problem}), and a command that began elsewhere than where they stand "
                    "would be a jump: check the robot, or say reports_joints = false in the neck file if it has no "
                    "encoders and stands at rest"
                )
            self._clock.sleep_until_s(self._clock.now_s() + self._neck.servo_period_s)
        return None

    def _go_in(self, start_rad: FloatArray, stop: threading.Event) -> None:
        """Bring a neck that stands in the last bit of its range slowly to where commands may be."""
        for k, command_rad in enumerate(way_in_rad(self._neck, start_rad)):
            if stop.is_set():
                return
            if k == 0:
                start_s = self._clock.now_s()
            self._clock.sleep_until_s(start_s + k * self._neck.servo_period_s)
            self._robot.send_command(command_rad)

    def _tick_until_stopped(
        self, loop: GazeLoop, smoother: Smoother, stop: threading.Event, duration_s: float | None
    ) -> None:
        start_s, rate_hz = self._clock.now_s(), self._neck.servo_rate_hz
        index, stopping_at = 0, None
        failure: BaseException | None = None
        limits = self._neck.command_limits
        ramp_s = limits.velocity_max_rad_s / limits.acceleration_max_rad_s2
        ramp_s += limits.acceleration_max_rad_s2 / limits.jerk_max_rad_s3
        stopping_s = max(_STOPPING_S, 2.0 * float(np.max(ramp_s)))
        while True:
            due_s = start_s + index * self._neck.servo_period_s
            self._clock.sleep_until_s(due_s)
            now_s = self._clock.now_s()
            self.report.lateness.add(1e3 * (now_s - due_s))
            # Ticks that are over by now are left out: a burst of commands would help nobody.
            over = int((now_s - due_s) * rate_hz + 1e-6)
            self.report.skipped_ticks += over
            index += over
            if stopping_at is None and (why := self._why_stop(stop, now_s - start_s, duration_s)):
                self.report.stopped_by, stopping_at = why, now_s
                loop.stop()
            try:
                if failure is None:
                    self._tick(loop, index, now_s, start_s, stopping_at is not None)
                else:
                    # Not even the loop can be relied on any more.
                    self._robot.send_command(smoother.step(now_s, None).position_rad)
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
        if failure is not None:
            raise failure

    def _why_stop(self, stop: threading.Event, elapsed_s: float, duration_s: float | None) -> str:
        if stop.is_set():
            return "signal"
        if self._source.finished:
            return "end of the source"
        return "duration" if duration_s is not None and elapsed_s >= duration_s else ""

    def _tick(self, loop: GazeLoop, index: int, now_s: float, start_s: float, stopping: bool) -> None:
        self.report.ticks += 1
        if isinstance(self._clock, RealClock) and self._clock.unix_clock_stepped():
            self._recorder.event(now_s, "clock_stepped")
        if self._true_state is not None:
            self._true_joints.append(self._true_state())
        due_s = start_s + index * self._neck.servo_period_s
        loop.tick(index, now_s, [] if stopping else self._arrived(now_s), due_s)
        if loop.joints is not None:
            self._joints.add(now_s, loop.joints.position_rad, loop.joints.velocity_rad_s)
        if self.report.ticks % self._log_ticks == 0:
            self._keep_log()
            loop.record_to(self._recorder)
        if not stopping:
            self._raise_if_not_kept()

    def _arrived(self, now_s: float) -> list[Sighting]:
        arrived = self._source.poll()
        found, problems = [], list(arrived.problems)
        # What has piled up is old; taking it all in would hold up the tick.
        if len(arrived.sightings) > _NEWEST:
            self._recorder.event(now_s, "observations_dropped")
        for sighting in arrived.sightings[-_NEWEST:]:
            try:
                found.append(Sighting(sighting.arrival_s, self._in_base(sighting)))
            except ValueError as error:
                problems.append(str(error))
        self.report.observations += len(arrived.sightings)
        for problem in problems:
            self._recorder.event(now_s, "bad_observation")
            if len(self.report.problems) < _PROBLEMS_KEPT:
                self.report.problems.append(problem)
        self.report.n_problems += len(problems)
        return found

    def _in_base(self, sighting: Sighting) -> HeadObservation:
        observation = sighting.observation
        angles_rad = self._joints.at(observation.capture_time_s) if self._mount.on == "head" else None
        return self._mount.to_base(observation, self._neck.geometry, angles_rad)

    def _keep_log(self) -> None:
        """Hand the log so far over to be written; that takes many ticks' time, so it is not waited for."""
        recorder, self._recorder = self._recorder, LoopRecorder(self._neck.control_period_s)
        true_joints, self._true_joints = self._true_joints, []
        if recorder.ticks:
            self._written.append(self._writer.submit(self._write, recorder, true_joints))
            if not isinstance(self._clock, RealClock):
                # A simulated run would be far ahead of its logs.
                wait(self._written)

    def _write(self, recorder: LoopRecorder, true_joints: list[JointState | None]) -> None:
        self._keep(*recorder.finish(self._about, self._true_head, true_joints or None))

    def _raise_if_not_kept(self) -> None:
        while self._written and self._written[0].done():
            self._written.popleft().result()


def _unknown(times_s: FloatArray) -> FloatArray:
    return np.full((times_s.size, 3), np.nan)
