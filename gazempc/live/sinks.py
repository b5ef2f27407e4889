"""Where lines of `--attention-out` go: a UDP address, a ROS 2 topic, or a file."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import IO, Protocol

from gazempc.errors import SettingsError
from gazempc.ros2.node import Ros2Node
from gazempc.ros2.topics import Publication
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
