"""Counters and logs of a live run, in constant memory; logs are made in the background."""

from __future__ import annotations

import math
import threading
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from gazempc.live.setup import LiveSetup
from gazempc.loop.boundary import boundary
from gazempc.loop.events import Event
from gazempc.loop.recorder import JointColumns, LoopRecorder
from gazempc.results.log import ComputeTimes, Fault, Log, merge_faults
from gazempc.results.moments import CutMoment, JointsMoment, Moment
from gazempc.robots.robot import checked_reading
from gazempc.types import JointState

_BIN_MS = 0.01
_BINS = 100_000  # up to 1 s; the last one holds all that is later


class Lateness:
    """A histogram of times with bins of 10 microseconds.

    Attributes:
        max_ms: The largest, milliseconds.
    """

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self.max_ms = 0.0

    def add(self, late_ms: float) -> None:
        """Add a time, milliseconds; a negative one counts as 0."""
        self._counts[min(max(int(late_ms / _BIN_MS), 0), _BINS - 1)] += 1
        self.max_ms = max(self.max_ms, late_ms)

    @property
    def count(self) -> int:
        """Number of times."""
        return int(self._counts.sum())

    def beyond(self, limit_ms: float) -> int:
        """Number of times above a limit, up to 1 s, with a resolution of 10 microseconds."""
        return int(self._counts[int(limit_ms / _BIN_MS) :].sum())

    def percentile_ms(self, percent: float) -> float:
        """The upper edge of the bin that contains a percentile.

        Args:
            percent: 0 to 100.

        Returns:
            Milliseconds; 0 if empty; the maximum if it is beyond 1 s.
        """
        if not self.count:
            return 0.0
        k = int(np.searchsorted(np.cumsum(self._counts), max(percent / 100.0 * self.count, 1.0)))
        return self.max_ms if k == _BINS - 1 else min((k + 1) * _BIN_MS, self.max_ms)


@dataclass
class LiveReport:
    """Statistics of a live run, of bounded size.

    Attributes:
        ticks: Number of executed ticks.
        skipped_ticks: Number of ticks skipped because the previous one was too long.
        lateness: Histogram of the delays of ticks.
        observations: Number of observations that arrived, valid or not.
        problems: Texts of the first 20 invalid observations.
        warnings: Probable set-up errors: event, finding and correction of each kind.
        least_age_s: Minimum over the run of the least age of frames, by their stamps, seconds; negative for stamps in
            the future.
        greatest_age_s: Maximum over the run of the same.
        stopped_by: Reason for the end of the run.
    """

    ticks: int = 0
    skipped_ticks: int = 0
    lateness: Lateness = field(default_factory=Lateness)
    observations: int = 0
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    least_age_s: float = math.inf
    greatest_age_s: float = -math.inf
    stopped_by: str = ""


LogSink = Callable[[Log, ComputeTimes], None]


class LiveLogs:
    """Splits the records into logs of bounded length.

    The thread of the run records and splits. Any thread may call `snapshot` and read the properties.

    Args:
        setup: The parts of the run.
        sink: Called with each complete log, in a separate thread.
        listen: Called with each moment, in the thread of the run; None without listeners.

    Attributes:
        recorder: The recorder in use; another one after each cut.
    """

    def __init__(self, setup: LiveSetup, sink: LogSink, listen: Callable[[Moment], None] | None) -> None:
        self._setup, self._sink, self._listen = setup, sink, listen
        self._true_state: Callable[[], JointState] | None = getattr(setup.robot, "true_state", None)
        self._log_ticks = max(1, round(setup.log_s * setup.neck.servo_rate_hz))
        self.recorder = self._new_recorder()
        self._true_joints = JointColumns(setup.neck.joints)
        self._writer = ThreadPoolExecutor(1, "log")
        self._writer.submit(int)  # its thread begins now, not in a tick
        self._written: deque[Future[None]] = deque()
        # Guards all below; held for a few microseconds at most.
        self._lock = threading.Lock()
        self._asked: list[Future[None]] = []
        self._closed = False
        self._events: Counter[str] = Counter()
        self._used = 0
        self._refused: Counter[str] = Counter()
        self._faults: tuple[Fault, ...] = ()
        # Complete, but not written yet.
        self._cut: list[LoopRecorder] = []

    def _new_recorder(self) -> LoopRecorder:
        return LoopRecorder(self._setup.neck.control_period_s, self._listen)

    def note_true_joints(self, time_s: float) -> None:
        """Record the true joints of a simulated robot at this tick.

        Args:
            time_s: The time, seconds.
        """
        if self._true_state is None:
            return
        joints: JointState | None = None
        note = partial(self.recorder.event, time_s, Event.ROBOT_NOT_ANSWERING)
        with boundary(self._setup.robot, "true_state", note):
            joints = checked_reading(self._true_state(), self._setup.neck, "true_state")
        self._true_joints.append(joints)
        if self._listen is not None and joints is not None:
            self._listen(JointsMoment(joints))

    @property
    def due(self) -> bool:
        """Whether the log has reached its length."""
        return self.recorder.ticks >= self._log_ticks or bool(self._asked)

    def cut(self) -> None:
        """End the present log and pass it to a thread, as its construction takes many ticks."""
        true_joints, self._true_joints = self._true_joints, JointColumns(self._setup.neck.joints)
        with self._lock:
            recorder, self.recorder = self.recorder, self._new_recorder()
            asked, self._asked = self._asked, []
            self._events.update(recorder.events)
            self._used += recorder.used
            self._refused.update(recorder.refusals)
            self._cut += [recorder] * bool(recorder.ticks or recorder.events)
        if recorder.ticks:
            if self._listen is not None:
                self._listen(CutMoment())
            self._written.append(self._writer.submit(self._write, recorder, true_joints))
            if not self._setup.clock.is_real:
                # Backpressure: a simulated run would be far ahead of its logs.
                wait(self._written)
        for each in asked:
            # The writer is sequential: at this point the log above is stored.
            self._writer.submit(each.set_result, None)

    def snapshot(self) -> Future[None]:
        """Request the end of the log at the next tick.

        Returns:
            Resolved after all records before this call are stored.
        """
        kept: Future[None] = Future()
        with self._lock:
            if self._closed:
                kept.set_result(None)
            else:
                self._asked.append(kept)
        return kept

    @property
    def events(self) -> dict[str, int]:
        """Count of each event over all logs; a lasting event counts once."""
        with self._lock:
            return dict(sorted((self._events + Counter(self.recorder.events)).items()))

    @property
    def used(self) -> int:
        """Number of observations used by the predictor, over all logs."""
        with self._lock:
            return self._used + self.recorder.used

    @property
    def refused(self) -> dict[str, int]:
        """Number of refused observations by the name of the event, over all logs; most frequent first."""
        with self._lock:
            return dict((self._refused + Counter(self.recorder.refusals)).most_common())

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The exceptions caught, over all logs."""
        with self._lock:
            known, recorders = self._faults, (*self._cut, self.recorder)
        return merge_faults((*known, *(fault for each in recorders for fault in each.faults)))

    def check(self) -> None:
        """Raise an exception of the writer, such as a full disk."""
        while self._written and self._written[0].done():
            self._written.popleft().result()

    def close(self) -> None:
        """Pass on the last log and wait until all are stored."""
        with self._lock:
            self._closed = True
        self.cut()
        self._writer.shutdown()

    def _write(self, recorder: LoopRecorder, true_joints: JointColumns) -> None:
        faults = recorder.faults
        with self._lock:
            self._faults = merge_faults((*self._faults, *faults))
            self._cut.remove(recorder)
        self._sink(*recorder.finish(self._setup.about, self._setup.true_head_base_m, true_joints))
