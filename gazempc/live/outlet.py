"""Output of the attended person: a line of JSON at each change, to a UDP address, a ROS 2 topic or a file."""

from __future__ import annotations

import json
import queue
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import asdict
from pathlib import Path

from gazempc.errors import SettingsError
from gazempc.live.clock import Clock
from gazempc.people.attention import AttentionState
from gazempc.ros2.messages import Ros2Error, topic_name
from gazempc.ros2.node import Ros2Node, message_type

_OPTION = "--attention-out"
_ACCEPTED = "udp:HOST:PORT, ros2:TOPIC, or a file FILE.jsonl"
_TEXT = "std_msgs/msg/String"
# Length of the queue while a sink blocks.
_WAITING = 1000
# Timeout for the last lines at the end of a run.
_LAST_SENT_S = 2.0
_TIMES = ("time_s", "since_s", "stays_until_s", "away_since_s", "away_until_s")

# Context manager whose value sends one line, without line end; may raise any exception.
Sink = AbstractContextManager[Callable[[str], object]]


@contextmanager
def _udp(host: str, port: int) -> Iterator[Callable[[str], object]]:
    """A datagram a line; a missing receiver is not an error."""
    family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    with socket.socket(family, socket.SOCK_DGRAM) as opened:
        yield lambda line: opened.sendto(line.encode() + b"\n", address)


@contextmanager
def _ros2(topic: str) -> Iterator[Callable[[str], object]]:
    """A ``std_msgs/msg/String`` a line; a later subscriber gets the last one (transient local)."""
    with closing(Ros2Node("gazempc_attention")) as node:
        publication, text = node.publication(topic, _TEXT, latched=True), message_type(_TEXT)
        yield lambda line: publication.publish(text(data=line))


@contextmanager
def _file(path: Path) -> Iterator[Callable[[str], object]]:
    """Lines of a file, which is truncated first."""
    with path.open("w", encoding="utf-8") as file:
        yield lambda line: print(line, file=file, flush=True)


def make_sink(word: str) -> Sink:
    """Make a sink from its name; not open yet.

    Args:
        word: ``udp:HOST:PORT``, ``ros2:TOPIC`` or a file's name with the ending ``.jsonl``.

    Returns:
        The sink; opening it raises OSError, UnicodeError or Ros2Error if that is impossible.

    Raises:
        SettingsError: If the name is invalid.
    """
    kind, _, address = word.partition(":")
    host, _, port = address.rpartition(":")
    if kind == "udp" and host and port.isdecimal() and 0 < int(port) < 65536:
        return _udp(host.strip("[]"), int(port))
    if kind == "ros2" and address:
        return _ros2(topic_name(address))
    if word.endswith(".jsonl"):
        return _file(Path(word))
    raise SettingsError(f"{_OPTION} {word}: no such place; accepted: {_ACCEPTED}")


class AttentionOutlet:
    """Sends states within a with-block, in a separate thread.

    Args:
        sink: Receives the lines.
        clock: The loop's clock. Lines of a real one have Unix time, others the time of the loop.
    """

    def __init__(self, sink: Sink, clock: Clock) -> None:
        self._sink, self._clock = sink, clock
        self._last: AttentionState | None = None
        self._queue: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._failed: deque[Exception] = deque(maxlen=_WAITING)
        self._open = ExitStack()

    def __enter__(self) -> AttentionOutlet:
        """Open the sink.

        Raises:
            SettingsError: If it cannot be opened.
        """
        try:
            send = self._open.enter_context(self._sink)
        except (OSError, UnicodeError, Ros2Error) as error:  # the second one: a name with an empty part
            raise SettingsError(f"{_OPTION}: cannot be opened: {error}") from None
        self._thread = threading.Thread(target=self._work, args=(send,), name="attention", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Report the end, and send all queued lines."""
        self.report(self._clock.now_s(), AttentionState(why="ended"))
        self._queue.put(None)
        self._thread.join(_LAST_SENT_S)
        if not self._thread.is_alive():
            self._open.close()

    def report(self, now_s: float, state: AttentionState) -> Sequence[Exception]:
        """Report the state of attention; non-blocking; sends a line after a change: its fields and ``time_s``.

        Args:
            now_s: The time, seconds.
            state: The state of attention.

        Returns:
            Exceptions of lines that could not be sent since the last call.
        """
        if state != self._last and self._queue.qsize() < _WAITING:
            self._last = state
            fields = {"time_s": now_s, **asdict(state)}
            for name in _TIMES:
                fields[name] = None if fields[name] is None else round(fields[name] - self._clock.from_unix_s(0.0), 4)
            self._queue.put(json.dumps(fields))
        return [self._failed.popleft() for _ in range(len(self._failed))]

    def _work(self, send: Callable[[str], object]) -> None:
        while (line := self._queue.get()) is not None:
            try:
                send(line)
            except Exception as error:
                self._failed.append(error)
