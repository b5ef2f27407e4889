"""Reports of whom the robot looks at: a line of JSON at each change, to a UDP address, a ROS 2 topic or a file."""

from __future__ import annotations

import json
import queue
import socket
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import IO, Protocol

from gazempc.errors import SettingsError
from gazempc.live.clock import Clock
from gazempc.live.settings import LiveSettings
from gazempc.people.attention import AttentionState
from gazempc.ros2.node import Publication, Ros2Node
from gazempc.ros2.wire import Ros2Network, WireError, make_message, topic_name

_OPTION = "--attention-out"
_ACCEPTED = "udp:HOST:PORT, ros2:TOPIC, or a file FILE.jsonl"
_NODE_NAME = "gazempc_attention"  # this program in the graph of ROS 2
_TEXT = "std_msgs/msg/String"


class Sink(Protocol):
    """Takes lines."""

    def open(self) -> None:
        """Get ready; raises SettingsError if that cannot be."""
        ...

    def send(self, line: str) -> None:
        """Send one line without its end; may raise anything."""
        ...

    def close(self) -> None:
        """Take no more."""
        ...


class UdpSink:
    """A datagram a line.

    Args:
        host: Name or address.
        port: Port.
    """

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """See `Sink.open`."""
        try:
            family, *_, address = socket.getaddrinfo(self._host, self._port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            # Whoever does not listen yet is no error.
            self._to = address
        except (OSError, UnicodeError) as error:  # the last one: a name with an empty part
            why = getattr(error, "strerror", None) or error
            raise SettingsError(f"{_OPTION} udp:{self._host}:{self._port}: {why}") from None

    def send(self, line: str) -> None:
        """See `Sink.send`."""
        if self._socket is not None:
            self._socket.sendto(line.encode() + b"\n", self._to)

    def close(self) -> None:
        """See `Sink.close`."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class Ros2Sink:
    """A ``std_msgs/msg/String`` a line; who listens later gets the last one (transient local).

    Args:
        topic: Its name.
        network: Router, domain and release of ROS 2.

    Raises:
        SettingsError: If ROS 2 allows no such topic.
    """

    def __init__(self, topic: str, network: Ros2Network) -> None:
        self._topic, self._network = topic_name(topic), network
        self._node: Ros2Node | None = None
        self._publication: Publication | None = None

    def open(self) -> None:
        """See `Sink.open`."""
        try:
            self._node = Ros2Node(_NODE_NAME, self._network)
            self._publication = self._node.publication(self._topic, _TEXT, latched=True)
        except WireError as error:
            self.close()
            raise SettingsError(f"{_OPTION} ros2:{self._topic}: {error}") from None

    def send(self, line: str) -> None:
        """See `Sink.send`."""
        if self._node is None or self._publication is None:
            return
        if not self._node.connected:
            raise WireError(f"the Zenoh router at {self._network.endpoint} has gone; trying to reach it again")
        self._publication.publish(make_message(_TEXT, data=line))

    def close(self) -> None:
        """See `Sink.close`."""
        if self._node is not None:
            self._node.close()
        self._node = self._publication = None


class FileSink:
    """Lines of a file, which begins anew.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: IO[str] | None = None

    def open(self) -> None:
        """See `Sink.open`."""
        try:
            self._file = self._path.open("w", encoding="utf-8")
        except OSError as error:
            raise SettingsError(f"{_OPTION} {self._path}: cannot be written: {error.strerror or error}") from None

    def send(self, line: str) -> None:
        """See `Sink.send`."""
        if self._file is not None:
            self._file.write(line + "\n")
            self._file.flush()

    def close(self) -> None:
        """See `Sink.close`."""
        if self._file is not None:
            self._file.close()
            self._file = None


def make_sink(word: str, network: Ros2Network) -> Sink:
    """Make what a word names; nothing is open yet.

    Args:
        word: ``udp:HOST:PORT``, ``ros2:TOPIC`` or a file's name with the ending ``.jsonl``.
        network: Router, domain and release of ROS 2.

    Returns:
        The sink.

    Raises:
        SettingsError: If it names none.
    """
    kind, _, address = word.partition(":")
    if kind == "udp":
        host, _, port = address.rpartition(":")
        if host and port.isdecimal() and 0 < int(port) < 65536:
            return UdpSink(host.strip("[]"), int(port))
    elif kind == "ros2" and address:
        return Ros2Sink(address, network)
    elif word.endswith(".jsonl"):
        return FileSink(Path(word))
    raise SettingsError(f"{_OPTION} {word}: no such place; accepted: {_ACCEPTED}")


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
            self._queue.put(line_of(state, now_s, -self._clock.from_unix_s(0.0)))
        return [self._failed.popleft() for _ in range(len(self._failed))]

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
