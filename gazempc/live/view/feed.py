"""Passes what happens in a run on to the process for viewers. The run never waits for it."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gazempc.live.view.child import ViewProcess
from gazempc.live.view.orders import LogKept
from gazempc.results.moments import CutMoment, Moment, TickMoment
from gazempc.types import FloatArray

# Some ten seconds of a run at 200 Hz; beyond them the oldest moments are dropped.
_MOST = 8192
# A viewer sees this as at once.
_PERIOD_S = 0.04
# Without ticks, as before the first one.
_IDLE_S = 0.2
# Pickling holds the interpreter: so few moments at once take less than a tick can wait.
_AT_ONCE = 8
_ENDS_WITHIN_S = 20.0


class Feed:
    """Takes moments in the thread of the run; a thread of its own sends them.

    Args:
        process: Where they go; started.
        true_head_base_m: True head positions, shape (H, 3), metres, at times, shape (H,), seconds; None if not known.
        waits: Let the run wait for the process, and drop nothing: for a simulated clock.

    Attributes:
        lost: How many moments did not reach the process.
    """

    def __init__(
        self,
        process: ViewProcess,
        true_head_base_m: Callable[[FloatArray], FloatArray] | None = None,
        waits: bool = False,
    ) -> None:
        self._process, self._true_head_base_m, self._waits = process, true_head_base_m, waits
        self._waiting: deque[Moment | LogKept] = deque()
        self.lost = 0
        self._stop = False
        self._due = threading.Event()
        self._due_s = -math.inf
        # Held while sending: a run on a simulated clock sends, too.
        self._sending = threading.Lock()
        self._thread = threading.Thread(target=self._pump, name="feed", daemon=True)
        self._thread.start()

    def watch(self, moment: Moment) -> None:
        """Take a moment; for the thread of the run, and returns at once.

        Args:
            moment: What happened.
        """
        self._waiting.append(moment)
        if isinstance(moment, TickMoment) and moment.time_s >= self._due_s:
            # Right after a tick: by the next one it has been sent, and does not hold the interpreter then.
            self._due_s = moment.time_s + _PERIOD_S
            self._due.set()
        if len(self._waiting) > _MOST:
            if self._waits:
                self._send()
            else:
                self._drop()

    def kept(self, path: Path) -> None:
        """Say that a log is complete.

        Args:
            path: The ``.npz`` file.
        """
        self._waiting.append(LogKept(path, self.lost))

    def close(self) -> None:
        """Send what is left, and end the process."""
        self._stop = True
        self._due.set()
        self._thread.join(_ENDS_WITHIN_S)
        if not self._thread.is_alive():
            self._send()
        self._process.close()

    def _drop(self) -> None:
        # The newest counts. Where a log ends and where it is must not be lost.
        kept: list[Moment | LogKept] = []
        try:
            while isinstance(oldest := self._waiting.popleft(), (CutMoment, LogKept)):
                kept.append(oldest)
            self.lost += 1
        except IndexError:
            pass  # all has been sent meanwhile
        self._waiting.extendleft(reversed(kept))

    def _pump(self) -> None:
        while not self._stop:
            self._due.wait(_IDLE_S)
            self._due.clear()
            self._send()

    def _send(self) -> None:
        with self._sending:
            for _ in range(len(self._waiting) // _AT_ONCE + 1):
                batch: list[Moment | LogKept] = []
                try:
                    while len(batch) < _AT_ONCE:
                        batch.append(self._waiting.popleft())
                except IndexError:
                    pass
                if batch:
                    self._process.send(self._with_true_heads(batch))

    def _with_true_heads(self, batch: list[Moment | LogKept]) -> list[object]:
        ticks = [moment.time_s for moment in batch if isinstance(moment, TickMoment)]
        if self._true_head_base_m is None or not ticks:
            return list(batch)
        heads = iter(self._true_head_base_m(np.array(ticks)))
        return [
            moment._replace(head_true_base_m=next(heads)) if isinstance(moment, TickMoment) else moment
            for moment in batch
        ]
