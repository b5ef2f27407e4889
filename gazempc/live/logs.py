"""The logs of a live run: one after the other, each made in the background, so that memory does not grow."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait

from gazempc.live.setup import LiveSetup
from gazempc.loop.boundary import PartError, boundary
from gazempc.loop.columns import JointColumns
from gazempc.loop.events import Event
from gazempc.loop.recorder import LoopRecorder
from gazempc.results.log import ComputeTimes, Fault, Log, merge_faults
from gazempc.results.moments import CutMoment, JointsMoment, Moment
from gazempc.robots.robot import wrong_reading
from gazempc.types import JointState

LogSink = Callable[[Log, ComputeTimes], None]


class LiveLogs:
    """Cuts what is recorded into logs and hands each one over.

    The thread of the run records and cuts. Any thread may call `snapshot` and read the properties.

    Args:
        setup: The parts of the run.
        sink: Takes each log as soon as it is complete, in a thread of its own.
        listen: Gets each moment, in the thread of the run; None without listeners.

    Attributes:
        recorder: The recorder in use; another one after each cut.
    """

    def __init__(self, setup: LiveSetup, sink: LogSink, listen: Callable[[Moment], None] | None) -> None:
        self._setup, self._sink, self._listen = setup, sink, listen
        self._true_state = setup.true_state
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
        # Cut, and not written yet.
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
        try:
            with boundary(self._setup.robot, "true_state"):
                found = self._true_state()
                if wrong := wrong_reading(found, self._setup.neck):
                    raise ValueError(wrong.replace("read_state", "true_state"))
                joints = found
        except PartError as error:
            self.recorder.event(time_s, Event.ROBOT_NOT_ANSWERING, error)
        self._true_joints.append(joints)
        if self._listen is not None and joints is not None:
            self._listen(JointsMoment(joints))

    @property
    def due(self) -> bool:
        """Whether it is time to cut."""
        return self.recorder.ticks >= self._log_ticks or bool(self._asked)

    def cut(self) -> None:
        """End the log so far and hand it over to a thread: making it takes many ticks' time."""
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
                # A simulated run would be far ahead of its logs.
                wait(self._written)
        for each in asked:
            # The writer works in order: then the log above is kept.
            self._writer.submit(each.set_result, None)

    def snapshot(self) -> Future[None]:
        """Ask for a cut at the next tick.

        Returns:
            Done once all that was recorded before this call is kept.
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
        """How often each event began, over all logs."""
        with self._lock:
            return dict(sorted((self._events + Counter(self.recorder.events)).items()))

    @property
    def used(self) -> int:
        """How many observations the predictor was given, over all logs."""
        with self._lock:
            return self._used + self.recorder.used

    @property
    def refused(self) -> dict[str, int]:
        """How many observations were not used, by the name of the event, over all logs; most first."""
        with self._lock:
            return dict((self._refused + Counter(self.recorder.refusals)).most_common())

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The exceptions that were survived, over all logs."""
        with self._lock:
            known, recorders = self._faults, (*self._cut, self.recorder)
        return merge_faults((*known, *(fault for each in recorders for fault in each.faults)))

    def check(self) -> None:
        """Raise what came up while a log was kept, such as a full disk."""
        while self._written and self._written[0].done():
            self._written.popleft().result()

    def close(self) -> None:
        """Hand the last log over and wait until all are kept."""
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
