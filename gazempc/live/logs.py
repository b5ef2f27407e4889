"""The logs of a live run: one after the other, each made in the background, so that memory does not grow."""

from __future__ import annotations

import threading
from collections import Counter, deque
from concurrent.futures import Future, ThreadPoolExecutor, wait

from gazempc.live.clock import RealClock
from gazempc.live.parts import Keeping, LiveParts
from gazempc.loop.columns import JointColumns
from gazempc.loop.recorder import LoopRecorder
from gazempc.results.log import Fault, merge_faults
from gazempc.results.moments import CutMoment, JointsMoment


class LiveLogs:
    """Cuts what is recorded into logs and hands each one over.

    The thread of the run records and cuts. Any thread may call `snapshot` and read the properties.

    Args:
        parts: The parts of the run.
        keeping: What the logs say, and who takes them.

    Attributes:
        recorder: Where to record now; another one after each cut.
    """

    def __init__(self, parts: LiveParts, keeping: Keeping) -> None:
        self._keeping = keeping
        self._control_period_s = parts.neck.control_period_s
        self._log_ticks = max(1, round(keeping.log_s * parts.neck.servo_rate_hz))
        # A simulated run would be far ahead of its logs.
        self._waits = not isinstance(parts.clock, RealClock)
        self.recorder = LoopRecorder(self._control_period_s, keeping.watch)
        self._joints = parts.neck.joints
        self._true_joints = JointColumns(self._joints)
        self._writer = ThreadPoolExecutor(1, "log")
        self._writer.submit(int)  # its thread begins now, not in a tick
        self._written: deque[Future[None]] = deque()
        # Guards all below. Nobody holds it for longer than a few microseconds.
        self._lock = threading.Lock()
        self._asked: list[Future[None]] = []
        self._closed = False
        self._events: Counter[str] = Counter()
        self._used = 0
        self._refused: Counter[str] = Counter()
        self._faults: tuple[Fault, ...] = ()

    def note_true_joints(self) -> None:
        """Record where the joints really are at this tick, if anybody knows."""
        if self._keeping.true_state is not None:
            joints = self._keeping.true_state()
            self._true_joints.append(joints)
            if self._keeping.watch is not None:
                self._keeping.watch(JointsMoment(joints))

    @property
    def due(self) -> bool:
        """Whether it is time to cut."""
        return self.recorder.ticks >= self._log_ticks or bool(self._asked)

    def cut(self) -> None:
        """End the log so far and hand it over. That takes many ticks' time, so nobody waits for it."""
        true_joints, self._true_joints = self._true_joints, JointColumns(self._joints)
        with self._lock:
            recorder, self.recorder = self.recorder, LoopRecorder(self._control_period_s, self._keeping.watch)
            asked, self._asked = self._asked, []
            self._events.update(recorder.events)
            self._used += recorder.used
            self._refused.update(recorder.refusals)
            self._faults = merge_faults((*self._faults, *recorder.faults))
        if recorder.ticks:
            if self._keeping.watch is not None:
                self._keeping.watch(CutMoment())
            self._written.append(self._writer.submit(self._write, recorder, true_joints))
            if self._waits:
                wait(self._written)
        for each in asked:
            # The writer does one thing after the other: then the log above is kept.
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
            return merge_faults((*self._faults, *self.recorder.faults))

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
        keeping = self._keeping
        keeping.keep(*recorder.finish(keeping.about, keeping.true_head_base_m, true_joints))
