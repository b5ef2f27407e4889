"""Viewers of a live run: a process of their own, to which a thread passes the moments of the run."""

from __future__ import annotations

import math
import multiprocessing
import pickle
import threading
from collections import deque
from collections.abc import Callable
from importlib.util import find_spec
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path

import numpy as np

from gazempc.errors import SettingsError
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import LiveSetup
from gazempc.live.sources.camera.source import CameraSource
from gazempc.live.view.orders import Ended, LogKept, ViewFailed, ViewOrders, ViewReady
from gazempc.live.view.serving import serve
from gazempc.results.moments import CutMoment, Moment, StatusMoment, TickMoment
from gazempc.types import FloatArray

# It imports what it needs, which takes a while on a busy computer.
_READY_WITHIN_S = 60.0
_ENDS_WITHIN_S = 20.0
LAYOUT = "foxglove_layout.json"


class ViewProcess:
    """Starts the process, sends it what happens, and ends it.

    Args:
        orders: What it does.

    Attributes:
        problem: Why something of it does not go on; empty while all is well.
    """

    def __init__(self, orders: ViewOrders) -> None:
        self._orders = orders
        self._process: SpawnProcess | None = None
        self._pipe: Connection | None = None
        self.problem = ""

    def start(self) -> tuple[str, ...]:
        """Start it, and wait until it is ready.

        Returns:
            Lines for the user.

        Raises:
            SettingsError: If an order cannot be carried out.
        """
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(self._orders, theirs), name="view", daemon=True)
        self._process.start()
        theirs.close()
        answer: object = None
        try:
            if self._pipe.poll(_READY_WITHIN_S):
                answer = self._pipe.recv()
        except (EOFError, OSError):
            pass
        if isinstance(answer, ViewReady):
            return answer.said
        self._process.kill()
        self._process.join()
        raise SettingsError(answer.why if isinstance(answer, ViewFailed) else "the process for viewers did not start")

    def send(self, batch: list[object]) -> None:
        """Send a batch; if the process has gone it is dropped, and `problem` gives the reason.

        Args:
            batch: Moments and orders.
        """
        if self._pipe is None or self._process is None:
            return
        try:
            self._pipe.send_bytes(pickle.dumps(batch, protocol=pickle.HIGHEST_PROTOCOL))
        except OSError:
            self._hear()
            self.problem = self.problem or "the process for viewers has gone"

    def close(self) -> None:
        """Wait until it has finished its files, and end it."""
        if self._process is None:
            return
        self.send([Ended()])
        self._process.join(_ENDS_WITHIN_S)
        self._hear()
        if self._process.is_alive():
            self.problem = self.problem or "the process for viewers did not end: its files may not be complete"
            self._process.kill()
            self._process.join()

    def _hear(self) -> None:
        try:
            while self._pipe is not None and self._pipe.poll():
                answer = self._pipe.recv()
                if isinstance(answer, ViewFailed):
                    self.problem = self.problem or answer.why
        except (EOFError, OSError):
            return


# Some ten seconds of a run at 200 Hz; beyond them the oldest moments are dropped.
_MOST = 8192
# A viewer sees this as at once.
_PERIOD_S = 0.04
# Without ticks, as before the first one.
_IDLE_S = 0.2
# Pickling holds the interpreter: so few moments at once take less than a tick can wait.
_AT_ONCE = 8


class Feed:
    """Takes moments in the thread of the run; a thread of its own sends them.

    Args:
        process: Where they go; started.
        true_head_base_m: True head positions, shape (H, 3), metres, at times, shape (H,), seconds; None if not known.
        waits: Let the run wait for the process, and drop nothing: for a simulated clock.
        notes: Lines for the user.
        files: Names of the files that are written beside MCAP files.

    Attributes:
        lost: How many moments did not reach the process.
    """

    def __init__(
        self,
        process: ViewProcess,
        true_head_base_m: Callable[[FloatArray], FloatArray] | None = None,
        waits: bool = False,
        notes: tuple[str, ...] = (),
        files: tuple[str, ...] = (),
    ) -> None:
        self.notes, self.files = notes, files
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

    def take(self, moment: Moment) -> None:
        """Take a moment; for the thread of the run, and returns at once.

        Args:
            moment: What happened.
        """
        if isinstance(moment, StatusMoment):
            return
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

    @property
    def problems(self) -> list[str]:
        """Faults of the viewers, one line each; for after the run."""
        lost = f"{self.lost} moments did not reach viewers and MCAP files, as these were too slow" if self.lost else ""
        return [line for line in (lost, self._process.problem) if line]

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


def start_viewers(settings: LiveSettings, setup: LiveSetup) -> Feed | None:
    """Start the process for viewers.

    Args:
        settings: The settings.
        setup: The parts of the run; the source is not open yet.

    Returns:
        The feed of moments; None where no viewer and no MCAP file is wanted.

    Raises:
        SettingsError: If a package is missing, a file cannot be written, or the address cannot be used.
    """
    # By default MCAP files are written if their package is installed.
    mcap = settings.log == "mcap" or (settings.log is None and find_spec("foxglove") is not None)
    if not mcap and settings.view is None:
        return None
    camera = setup.source if isinstance(setup.source, CameraSource) else None
    host, port = settings.view_address
    layout = settings.out / LAYOUT if settings.view == "foxglove" else None
    folder = settings.out if mcap else None
    process = ViewProcess(ViewOrders(setup.about, folder, settings.view, host, port, layout, camera is not None))
    notes = process.start()
    feed = Feed(process, setup.true_head_base_m, not setup.clock.is_real, notes, () if layout is None else (LAYOUT,))
    if camera is not None:
        camera.show_to(feed.take)
    return feed
