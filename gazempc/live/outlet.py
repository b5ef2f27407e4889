"""Tells others whom the robot looks at: a line of JSON at each change, sent by a thread of its own."""

from __future__ import annotations

import json
import queue
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict
from types import TracebackType

from gazempc.errors import SettingsError
from gazempc.live.clock import Clock, RealClock
from gazempc.live.settings import LiveSettings
from gazempc.live.sinks import Sink, make_sink
from gazempc.people.state import AttentionState

# Lines that wait for a disk that hangs; nobody looks at so many people.
_WAITING = 1000
# At the end the last lines are waited for; they take milliseconds.
_LAST_SENT_S = 2.0
_TIMES = ("since_s", "stays_until_s", "away_since_s", "away_until_s")


class AttentionOutlet:
    """Sends states within a with-block.

    Args:
        sink: Where they go.
        clock: The loop's clock. Lines of a real one have Unix time, others the time of the loop.
    """

    def __init__(self, sink: Sink, clock: Clock) -> None:
        self._sink, self._clock = sink, clock
        self._last: AttentionState | None = None
        self._queue: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="attention", daemon=True)
        self._failed: deque[Exception] = deque(maxlen=_WAITING)

    def __enter__(self) -> AttentionOutlet:
        """Open the sink.

        Raises:
            SettingsError: If that cannot be.
        """
        self._sink.open()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Say that it has ended, and send what is left."""
        self.tell(self._clock.now_s(), AttentionState(why="ended"))
        self._queue.put(None)
        self._thread.join(_LAST_SENT_S)
        if not self._thread.is_alive():
            self._sink.close()

    def tell(self, now_s: float, state: AttentionState) -> Sequence[Exception]:
        """Say whom the robot looks at; returns at once, and sends nothing where nothing has changed.

        Args:
            now_s: The time, seconds.
            state: Whom.

        Returns:
            What could not be sent since the last call, and why.
        """
        if state != self._last and self._queue.qsize() < _WAITING:
            self._last = state
            self._queue.put(line_of(state, now_s, self._unix_offset_s()))
        return [self._failed.popleft() for _ in range(len(self._failed))]

    def _unix_offset_s(self) -> float:
        return -self._clock.from_unix_s(0.0) if isinstance(self._clock, RealClock) else 0.0

    def _work(self) -> None:
        while (line := self._queue.get()) is not None:
            try:
                self._sink.send(line)
            except Exception as error:
                self._failed.append(error)


def line_of(state: AttentionState, now_s: float, offset_s: float) -> str:
    """A state as JSON.

    Args:
        state: The state.
        now_s: The time, on the loop's clock, seconds.
        offset_s: Unix time at which that clock began, seconds.

    Returns:
        The fields of the state, with ``time_s``; times are Unix time.
    """
    said = {"time_s": now_s, **asdict(state)}
    for name in ("time_s", *_TIMES):
        said[name] = None if said[name] is None else round(said[name] + offset_s, 4)
    return json.dumps(said)


def attention_sink(settings: LiveSettings) -> Sink | None:
    """Make where the state of attention goes, as the settings say.

    Args:
        settings: The settings.

    Returns:
        The sink, not open yet; None where nobody wants it.

    Raises:
        SettingsError: If settings do not go together, or name no place.
    """
    where = settings.attention_out
    if where is None:
        return None
    if not settings.several:
        raise SettingsError(
            "--attention-out: there is one person, who is looked at all the time; accepted with --attend, or "
            "--look-away.rhythm"
        )
    if where.startswith("ros2:") and settings.simulated_clock:
        raise SettingsError(f"--attention-out {where}: ROS 2 keeps real time; with a simulated clock name a file")
    return make_sink(where, settings.options.ros2.network)
