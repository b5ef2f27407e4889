"""Records the run of the loop, and converts the records to a log."""

from __future__ import annotations

import logging
import math
import traceback
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import wraps
from itertools import chain
from typing import Any

import numpy as np

from gazempc.controllers.controller import AxisMotion, Plan
from gazempc.loop.boundary import PartError
from gazempc.parts import error_line
from gazempc.results.log import FORECAST_HORIZONS_S, ComputeTimes, Fault, Log, RunInfo
from gazempc.results.moments import AttendedMoment, EventMoment, Moment, PlanMoment, SeenMoment, TickMoment
from gazempc.types import FloatArray, JointState
from predictors import Forecast, HeadObservation

_LOGGER = logging.getLogger("gazempc.loop")
# Upper bound of the numbers in a log; a variance may be infinite.
_MOST_M2 = 1e12
_HORIZONS = len(FORECAST_HORIZONS_S)
_NO_FORECAST = (np.full((_HORIZONS, 3), np.nan), np.full((_HORIZONS, 3, 3), np.nan), np.nan)


def columns(rows: array[float], *shapes: tuple[int, ...]) -> list[FloatArray]:
    """Columns of a table.

    Args:
        rows: The rows, one after the other.
        shapes: Shape of a row's part in each column, such as () for a number.

    Returns:
        One contiguous array a column, with rows along the first axis.
    """
    sizes = [math.prod(shape) for shape in shapes]
    parts = np.split(np.array(rows).reshape(-1, sum(sizes)), np.cumsum(sizes)[:-1], axis=1)
    return [np.ascontiguousarray(part).reshape(-1, *shape) for part, shape in zip(parts, shapes, strict=True)]


def reading(state: JointState | None, joints: int) -> Iterable[float]:
    """A reading of N joints as a row: time, N positions, N velocities; NaN for a missing one."""
    if state is None:
        return (math.nan,) * (1 + 2 * joints)
    return state.time_s, *state.position_rad.tolist(), *state.velocity_rad_s.tolist()


class JointColumns:
    """Joint readings, one row each.

    Args:
        joints: N, the number of joints.
        states: The first rows; None for missing readings.
    """

    def __init__(self, joints: int, states: Iterable[JointState | None] = ()) -> None:
        self._joints, self._rows = joints, array("d")
        for state in states:
            self.append(state)

    def __len__(self) -> int:
        return len(self._rows) // (1 + 2 * self._joints)

    def append(self, state: JointState | None) -> None:
        """Add a row."""
        self._rows.extend(reading(state, self._joints))

    def arrays(self) -> list[FloatArray]:
        """Times, shape (M,), positions and velocities, shape (M, N); NaN for missing readings."""
        return columns(self._rows, (), (self._joints,), (self._joints,))


class LoopRecorder:
    """Collects rows while the loop runs.

    A lasting event, which is repeated at every tick or plan, is recorded once, when it begins.

    Args:
        control_period_s: Time between two plans, seconds: longest repetition period of a lasting event.
        watch: Called with each moment as it is recorded; must not block. None: no listener.

    Attributes:
        used: Number of observations that the predictor used.
        ticks: Number of ticks recorded.
    """

    def __init__(self, control_period_s: float, watch: Callable[[Moment], None] | None = None) -> None:
        self._control_period_s = control_period_s
        self._watch = watch
        self._ticks, self._seen, self._seen_ids = array("d"), array("d"), list[str]()
        self._events: list[tuple[float, str]] = []
        self._attended: list[tuple[float, int, str]] = []
        self._away: list[tuple[float, float, str]] = []
        self._event_last_s: dict[str, float] = {}
        self._faults: dict[str, tuple[Fault, traceback.TracebackException]] = {}
        self.used = self.ticks = 0
        self._refused: Counter[str] = Counter()
        self._update_ms, self._step_ms, self._latency_ms = array("d"), array("d"), array("d")

    @property
    def events(self) -> list[str]:
        """Names of the events so far; may be read while another thread records."""
        return [name for _, name in list(self._events)]

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The exceptions caught so far; may be read while another thread records.

        Slow: the source lines of the tracebacks are read from files.
        """
        faults = list(self._faults.values())
        return tuple(replace(fault, traceback="".join(trace.format())) for fault, trace in faults)

    @property
    def refusals(self) -> dict[str, int]:
        """Number of observations that were not used, by the name of the event; may be read as `events`."""
        return dict(self._refused)

    def tick(
        self, time_s: float, state: JointState | None, sent_rad: FloatArray, motions: tuple[AxisMotion, ...]
    ) -> None:
        """Record one servo tick: measured joints (None if missing), angles sent (or due to speeds), command motions."""
        self.ticks += 1
        joints = reading(state, len(motions))
        self._ticks.extend((time_s, *joints, *sent_rad.tolist(), *chain.from_iterable(motions)))
        if self._watch is not None:
            self._watch(TickMoment(time_s, state, sent_rad, motions))

    def observation(
        self,
        time_s: float,
        observation: HeadObservation,
        forecast: Forecast | None,
        update_ms: float,
        used: bool = True,
    ) -> None:
        """Record an observation that was passed to the predictor.

        Args:
            time_s: Time of its arrival, seconds.
            observation: The observation.
            forecast: Forecast at `FORECAST_HORIZONS_S` from its capture; None if there is none.
            update_ms: Duration of the predictor's update, milliseconds.
            used: Whether the predictor used it.
        """
        self.used += used
        stated = _NO_FORECAST
        if forecast is not None:
            covariances_m2 = np.clip(forecast.covariances_m2, -_MOST_M2, _MOST_M2)
            stated = forecast.means_base_m, covariances_m2, forecast.degrees_of_freedom
        captured_s, head_m = observation.capture_time_s, observation.head_position_base_m
        whom = observation.person_id or ""
        self._seen.extend(np.concatenate([(time_s, captured_s), head_m, *(np.ravel(part) for part in stated)]).tolist())
        self._seen_ids.append(whom)
        self._update_ms.append(update_ms)
        if self._watch is not None:
            self._watch(SeenMoment(time_s, captured_s, head_m, observation.head_quat_wxyz, whom, *stated))

    def step(self, step_ms: float) -> None:
        """Record the computing time of forecast and plan, milliseconds."""
        self._step_ms.append(step_ms)

    def begins(self, time_s: float, plan: Plan, latency_ms: float) -> None:
        """Record that a plan takes effect.

        Args:
            time_s: The time, seconds.
            plan: The plan.
            latency_ms: Age of its newest observation, milliseconds.
        """
        self._latency_ms.append(latency_ms)
        if self._watch is not None:
            self._watch(PlanMoment(time_s, plan.start_s, plan.step_s, plan.position_rad, latency_ms))

    def refused(self, name: str, count: int = 1) -> None:
        """Count refused observations; their event, which may last, is recorded separately.

        Args:
            name: Name of the event.
            count: Number of observations.
        """
        self._refused[str(name)] += count

    def refuse(self, name: str, time_s: float, error: BaseException | None = None) -> None:
        """Record a refused observation, and its event.

        Args:
            name: Name of the event.
            time_s: Time, seconds.
            error: The exception that caused it.
        """
        self.refused(name)
        self.event(time_s, name, error)

    def attended(self, time_s: float, person: int, why: str) -> None:
        """Record a change of the attended person.

        Args:
            time_s: The time, seconds.
            person: Number of the person; 0 for none.
            why: The reason, one word.
        """
        self._attended.append((time_s, person, why))
        if self._watch is not None:
            self._watch(AttendedMoment(time_s, person, why))

    def looks_away(self, start_s: float, end_s: float, why: str) -> None:
        """Record a look away that has begun.

        Args:
            start_s: End of contact, seconds.
            end_s: Time of renewed contact, seconds.
            why: The reason, one word.
        """
        self._away.append((start_s, end_s, why))

    def event(self, time_s: float, name: str, error: BaseException | None = None) -> None:
        """Record an event.

        Args:
            time_s: Time, seconds.
            name: Name of the event.
            error: The exception that caused it. The first one of each event is kept with its traceback.
        """
        if error is not None:
            self._fault(str(name), error)
        last_s = self._event_last_s.get(name, -np.inf)
        if time_s - last_s > 2.5 * self._control_period_s:
            self._events.append((time_s, str(name)))
            if self._watch is not None:
                known = self._faults.get(str(name))
                self._watch(EventMoment(time_s, str(name), str(name) if known is None else known[0].line))
        self._event_last_s[name] = time_s

    def _fault(self, name: str, error: BaseException) -> None:
        if name in self._faults:
            fault, trace = self._faults[name]
            self._faults[name] = replace(fault, count=fault.count + 1), trace
            return
        # The traceback ends where the part raised.
        cause, line = (error.error, str(error)) if isinstance(error, PartError) else (error, error_line(error))
        # Source lines are read later: file access takes many ticks.
        trace = traceback.TracebackException.from_exception(cause, lookup_lines=False)
        self._faults[name] = Fault(name, 1, line, ""), trace
        _LOGGER.warning("%s: %s", name, line, exc_info=cause)

    def finish(
        self,
        run: RunInfo,
        true_head_base_m: Callable[[FloatArray], FloatArray],
        true_joints: JointColumns | None = None,
    ) -> tuple[Log, ComputeTimes]:
        """Make the log.

        Args:
            run: Description of the run.
            true_head_base_m: True head positions, shape (H, 3), metres, at times, shape (H,), seconds; NaN if unknown.
            true_joints: True joint states at each tick; None for the measured ones.

        Returns:
            The log, and the compute times.
        """
        horizons, joints = np.array(FORECAST_HORIZONS_S), (run.neck.joints,)
        time_s, *readings, sent_rad, motions = columns(self._ticks, (), (), joints, joints, joints, (*joints, 3))
        if true_joints is not None and len(true_joints):
            readings = [each[: time_s.size] for each in true_joints.arrays()]
        forecast = (_HORIZONS, 3), (_HORIZONS, 3, 3), ()
        arrivals, captures, heads, means, covariances, freedoms = columns(self._seen, (), (), (3,), *forecast)
        ahead = captures[:, None] + horizons
        log = Log(
            run=run,
            time_s=time_s,
            head_true_base_m=true_head_base_m(time_s),
            joint_time_s=readings[0],
            joint_position_rad=readings[1],
            joint_velocity_rad_s=readings[2],
            command_position_rad=sent_rad,
            command_velocity_rad_s=motions[:, :, 1].copy(),
            command_acceleration_rad_s2=motions[:, :, 2].copy(),
            capture_time_s=captures,
            arrival_time_s=arrivals,
            head_observed_base_m=heads,
            person_id=np.array(self._seen_ids, dtype=np.str_),
            forecast_mean_base_m=means,
            forecast_covariance_m2=covariances,
            forecast_degrees_of_freedom=freedoms,
            forecast_true_base_m=true_head_base_m(ahead.ravel()).reshape(means.shape),
            forecast_horizon_s=horizons,
            event_time_s=np.array([t for t, _ in self._events]),
            event_name=np.array([name for _, name in self._events], dtype=np.str_),
            attended_time_s=np.array([t for t, _, _ in self._attended]),
            attended_person=np.array([person for _, person, _ in self._attended], dtype=np.intp),
            attended_why=np.array([why for _, _, why in self._attended], dtype=np.str_),
            away_start_s=np.array([start_s for start_s, _, _ in self._away]),
            away_end_s=np.array([end_s for _, end_s, _ in self._away]),
            away_why=np.array([why for _, _, why in self._away], dtype=np.str_),
            identity_swap_time_s=np.empty(0),
            faults=self.faults,
        )
        return log, ComputeTimes(np.array(self._update_ms), np.array(self._step_ms), np.array(self._latency_ms))


def _later(record: Callable[..., None]) -> Callable[..., None]:
    @wraps(record)
    def note(self: LaterRecorder, *args: Any, **named: Any) -> None:
        self.notes.append(lambda recorder: record(recorder, *args, **named))

    return note


class LaterRecorder(LoopRecorder):
    """Buffers records of one thread, for replay to the recorder in use by another thread."""

    def __init__(self) -> None:
        super().__init__(0.0)
        self.notes: deque[Callable[[LoopRecorder], None]] = deque()

    event = _later(LoopRecorder.event)
    refuse = _later(LoopRecorder.refuse)
    refused = _later(LoopRecorder.refused)
    observation = _later(LoopRecorder.observation)
    attended = _later(LoopRecorder.attended)
    looks_away = _later(LoopRecorder.looks_away)

    def hand_on(self, recorder: LoopRecorder) -> None:
        """Replay the buffered records in order.

        Args:
            recorder: Receives the records.
        """
        while self.notes:
            self.notes.popleft()(recorder)
