"""Lines of JSON from standard input, UDP or TCP."""

from __future__ import annotations

import contextlib
import os
import queue
import select
import socket
import sys
import threading
from typing import Protocol

from gazempc.live.clock import RealClock
from gazempc.live.sources.json_lines import LineError, parse_line
from gazempc.live.sources.source import Arrived, SourceError
from gazempc.live.stamps import StampReader, Stamps
from gazempc.types import Sighting

_CHUNK = 65536
# How soon a reader notices that it is to end, or tries to connect again.
_WAKE_S = 0.2
# More than a second of a fast tracker: if nobody polls, the oldest are the ones to lose.
_WAITING_MAX = 1024
_LINE_MAX = 1_000_000


class Wire(Protocol):
    """Where bytes come from."""

    def open(self) -> None:
        """Open it; raises OSError."""
        ...

    def read(self) -> bytes | None:
        """Wait a moment for bytes: some, none (empty), or None once it has ended."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


class StandardInput:
    """Lines from another process through a pipe."""

    name = "standard input"

    def open(self) -> None:
        """See `Wire.open`."""
        self._fd = sys.stdin.fileno()

    def read(self) -> bytes | None:
        """See `Wire.read`."""
        ready, _, _ = select.select([self._fd], [], [], _WAKE_S)
        return (os.read(self._fd, _CHUNK) or None) if ready else b""

    def close(self) -> None:
        """See `Wire.close`."""


class UdpPort:
    """Datagrams, each with one or more whole lines.

    Args:
        host: Address to listen at.
        port: Port.
    """

    def __init__(self, host: str, port: int) -> None:
        self.name = f"UDP {host}:{port}"
        self._address = (host, port)

    def open(self) -> None:
        """See `Wire.open`."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(_WAKE_S)
        try:
            self._socket.bind(self._address)
        except OSError:
            self._socket.close()
            raise

    def read(self) -> bytes | None:
        """See `Wire.read`."""
        try:
            return self._socket.recv(_CHUNK) + b"\n"
        except TimeoutError:
            return b""

    def close(self) -> None:
        """See `Wire.close`."""
        self._socket.close()


class TcpClient:
    """A connection to a server of lines, opened again whenever it breaks.

    Args:
        host: Address to connect to.
        port: Port.
    """

    def __init__(self, host: str, port: int) -> None:
        self.name = f"TCP {host}:{port}"
        self._address = (host, port)
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """See `Wire.open`."""
        self._socket = socket.create_connection(self._address, timeout=2.0)
        self._socket.settimeout(_WAKE_S)

    def read(self) -> bytes | None:
        """See `Wire.read`; after the server has gone, tries again until it is back."""
        if self._socket is None:
            threading.Event().wait(_WAKE_S)
            with contextlib.suppress(OSError):
                self.open()
            return b""
        try:
            data = self._socket.recv(_CHUNK)
        except TimeoutError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.close()
            # Half a line from before belongs to nothing.
            return b"\n"
        return data

    def close(self) -> None:
        """See `Wire.close`."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class LineSource:
    """Reads lines in a thread of its own and parses them as `gazempc.live.sources.json_lines` says.

    Args:
        wire: Where the lines come from.
        clock: The loop's clock.
        stamps: How capture times are read; default: Unix time in seconds.
    """

    def __init__(
        self, wire: StandardInput | UdpPort | TcpClient, clock: RealClock, stamps: StampReader | None = None
    ) -> None:
        self._wire = wire
        self._clock = clock
        self._stamps = stamps or StampReader(Stamps(), clock)
        self._arrived: queue.Queue[Sighting | str] = queue.Queue(_WAITING_MAX)
        self._ended = threading.Event()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, name="source", daemon=True)

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`."""
        try:
            self._wire.open()
        except (OSError, AttributeError, ValueError) as error:  # the last two: standard input is closed
            why = getattr(error, "strerror", None) or error
            raise SourceError(f"{self._wire.name}: cannot be opened: {why}") from None
        self._thread.start()

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        sightings: list[Sighting] = []
        problems: list[str] = []
        for _ in range(self._arrived.qsize()):
            try:
                found = self._arrived.get_nowait()
            except queue.Empty:  # the reader has thrown the oldest away meanwhile
                break
            if isinstance(found, str):
                problems.append(found)
            else:
                sightings.append(found)
        return Arrived(tuple(sightings), tuple(problems))

    @property
    def finished(self) -> bool:
        """See `gazempc.live.sources.source.Source.finished`."""
        return self._ended.is_set() and self._arrived.empty()

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)

    def _work(self) -> None:
        try:
            self._read_lines()
        finally:
            self._wire.close()
            self._ended.set()

    def _read_lines(self) -> None:
        rest = b""
        number = 0
        while not self._closing.is_set():
            try:
                data = self._wire.read()
            except OSError:
                data = None
            if data is None:
                break
            arrival_s = self._clock.now_s()
            *lines, rest = (rest + data).split(b"\n")
            if len(rest) > _LINE_MAX:
                self._put(f"{self._wire.name}, line {number + 1}: longer than {_LINE_MAX} bytes")
                rest = b""
            for line in lines:
                if line.strip():
                    number += 1
                    self._put(self._parsed(line, number, arrival_s))
        if rest.strip():
            self._put(self._parsed(rest, number + 1, self._clock.now_s()))

    def _parsed(self, line: bytes, number: int, arrival_s: float) -> Sighting | str:
        text = line.decode("utf-8", errors="replace")
        try:
            return Sighting(arrival_s, parse_line(text, arrival_s, lambda stamp: self._stamps.loop_s(stamp, arrival_s)))
        except LineError as error:
            return f"{self._wire.name}, line {number}: {error}"

    def _put(self, found: Sighting | str) -> None:
        while True:
            try:
                return self._arrived.put_nowait(found)
            except queue.Full:
                with contextlib.suppress(queue.Empty):
                    self._arrived.get_nowait()


def parse_address(word: str, text: str, default_host: str) -> tuple[str, int]:
    """Host and port from ``PORT`` or ``HOST:PORT``.

    Args:
        word: The whole word, for the message.
        text: What stands after the kind of source.
        default_host: Host where none is given.

    Returns:
        Host and port.

    Raises:
        SourceError: If it is neither.
    """
    host, _, port = text.rpartition(":")
    if not (port.isdecimal() and 0 < int(port) < 65536):
        raise SourceError(f"{word}: no port; accepted: udp:PORT, udp:HOST:PORT, tcp:HOST:PORT, ports 1 to 65535")
    return host or default_host, int(port)
