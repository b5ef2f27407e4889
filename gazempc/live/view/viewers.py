"""Viewers of a live run: a separate process, to which a thread sends the moments of the run."""

from __future__ import annotations

import math
import threading
from collections import deque
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from gazempc.errors import SettingsError
from gazempc.live.process import start_child
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import LiveSetup, TrueHeadAt
from gazempc.live.sources.camera.source import CameraSource
from gazempc.live.view.serving import ViewOrders, serve
from gazempc.results.moments import CutMoment, Moment, StatusMoment, TickMoment

# Timeout of its start: imports are slow on a busy computer.
_READY_WITHIN_S = 60.0
_ENDS_WITHIN_S = 20.0
LAYOUT = "foxglove_layout.json"
# Length of the queue, some ten seconds at 200 Hz; beyond it the oldest moments are dropped.
_MOST = 8192
# Period of sending, not perceptible in a viewer.
_PERIOD_S = 0.04
# Without ticks, as before the first one.
_IDLE_S = 0.2
# Maximum number of moments sent at once: pickling holds the interpreter lock, and must be short relative to a tick.
_BATCH = 8


class Feed:
    """Queues moments in the thread of the run; a separate thread sends them to the process for viewers.

    Args:
        orders: Tasks of the process.
        true_head_base_m: True head positions, shape (H, 3), metres, at times, shape (H,), seconds; None if unknown.
        waits: Let the run wait for the process instead of dropping moments: for a simulated clock.

    Attributes:
        notes: Lines for the user.
        files: Names of the files written beside MCAP files.
        lost: Number of moments lost before the process.
        process: The process.

    Raises:
        SettingsError: If a task is impossible.
    """

    def __init__(self, orders: ViewOrders, true_head_base_m: TrueHeadAt | None = None, waits: bool = False) -> None:
        self._true_head_base_m, self._waits = true_head_base_m, waits
        self.files = () if orders.layout is None else (orders.layout.name,)
        self._waiting: deque[Moment | Path] = deque()
        self.lost, self._problem = 0, ""
        self._stop, self._due, self._due_s = False, threading.Event(), -math.inf
        # Held while sending, as a run on a simulated clock also sends.
        self._sending = threading.Lock()
        self.process, self._pipe = start_child("view", serve, orders)
        answer: object = "the process for viewers did not start"
        with suppress(EOFError, OSError):
            if self._pipe.poll(_READY_WITHIN_S):
                answer = self._pipe.recv()
        if not isinstance(answer, tuple):
            self.process.kill()
            self.process.join()
            raise SettingsError(str(answer))
        self.notes: tuple[str, ...] = answer
        self._thread = threading.Thread(target=self._pump, name="feed", daemon=True)
        self._thread.start()

    def take(self, moment: Moment) -> None:
        """Queue a moment, in the thread of the run; returns at once.

        Args:
            moment: The moment.
        """
        if isinstance(moment, StatusMoment):
            return
        self._waiting.append(moment)
        if isinstance(moment, TickMoment) and moment.time_s >= self._due_s:
            # Sent right after a tick: sending releases the interpreter lock before the next one.
            self._due_s = moment.time_s + _PERIOD_S
            self._due.set()
        if len(self._waiting) > _MOST:
            if self._waits:
                self._send()
            else:
                self._drop()

    def kept(self, path: Path) -> None:
        """Register a complete log.

        Args:
            path: The ``.npz`` file.
        """
        self._waiting.append(path)

    @property
    def problems(self) -> list[str]:
        """Faults of the viewers, one line each; call after the run."""
        lost = f"{self.lost} moments did not reach viewers and MCAP files, as these were too slow" if self.lost else ""
        return [line for line in (lost, self._problem) if line]

    def close(self) -> None:
        """Send the remaining moments, wait until the files are complete, and end the process."""
        self._stop = True
        self._due.set()
        self._thread.join(_ENDS_WITHIN_S)
        if not self._thread.is_alive():
            self._send()
            self._transmit([])
        self.process.join(_ENDS_WITHIN_S)
        self._receive()
        if self.process.is_alive():
            self._problem = self._problem or "the process for viewers did not end: its files may not be complete"
            self.process.kill()
            self.process.join()

    def _drop(self) -> None:
        # Drop the oldest moments, but keep ends and paths of logs.
        kept: list[Moment | Path] = []
        with suppress(IndexError):  # all were sent meanwhile
            while isinstance(oldest := self._waiting.popleft(), (CutMoment, Path)):
                kept.append(oldest)
            self.lost += 1
        self._waiting.extendleft(reversed(kept))

    def _pump(self) -> None:
        while not self._stop:
            self._due.wait(_IDLE_S)
            self._due.clear()
            self._send()

    def _send(self) -> None:
        with self._sending:
            for _ in range(len(self._waiting) // _BATCH + 1):
                moments: list[Moment | Path] = []
                with suppress(IndexError):
                    while len(moments) < _BATCH:
                        moments.append(self._waiting.popleft())
                if moments:
                    self._transmit(self._with_true_heads(moments))

    def _transmit(self, moments: list[object]) -> None:
        """Send moments; an empty list ends the process. Without a process they are dropped, with a note."""
        try:
            self._pipe.send(moments)
        except OSError:
            self._receive()
            self._problem = self._problem or "the process for viewers has ended"

    def _receive(self) -> None:
        with suppress(EOFError, OSError):
            while self._pipe.poll():
                problem = self._pipe.recv()
                self._problem = self._problem or str(problem)

    def _with_true_heads(self, moments: list[Moment | Path]) -> list[object]:
        times_s = [moment.time_s for moment in moments if isinstance(moment, TickMoment)]
        if self._true_head_base_m is None or not times_s:
            return list(moments)
        heads = iter(self._true_head_base_m(np.array(times_s)))
        return [m._replace(head_true_base_m=next(heads)) if isinstance(m, TickMoment) else m for m in moments]


def start_viewers(settings: LiveSettings, setup: LiveSetup) -> Feed | None:
    """Start the process for viewers.

    Args:
        settings: The settings.
        setup: The parts of the run; the source is not open yet.

    Returns:
        The feed of moments; None without viewer and MCAP files.

    Raises:
        SettingsError: If a package is missing, a file cannot be written, or the address cannot be used.
    """
    # By default MCAP files are written if their package is installed.
    mcap = settings.log == "mcap" or (settings.log is None and find_spec("foxglove") is not None)
    if not mcap and settings.view is None:
        return None
    camera = setup.source if isinstance(setup.source, CameraSource) else None
    layout = settings.out / LAYOUT if settings.view == "foxglove" else None
    folder = settings.out if mcap else None
    orders = ViewOrders(setup.about, folder, settings.view, *settings.view_address, layout, camera is not None)
    feed = Feed(orders, setup.true_head_base_m, not setup.clock.is_real)
    if camera is not None:
        camera.watch = feed.take
    return feed
