"""Where bytes of lines come from: standard input, UDP or TCP."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import threading
from typing import NamedTuple, Protocol

from gazempc.live.sources.senders import Address
from gazempc.live.sources.source import SourceError

_CHUNK = 16_384
_DATAGRAM = 65_536
# Of a flood so many are taken at once, so that the newest ones are not left in the system's buffer.
_DATAGRAMS = 256
# How soon a reader notices that it is to end, or tries to connect again.
_WAKE_S = 0.2


class Chunk(NamedTuple):
    """Bytes that came together.

    Attributes:
        data: The bytes.
        sender: Who sent them; None where there is only one who can.
    """

    data: bytes
    sender: Address | None = None


class Wire(Protocol):
    """Where bytes come from.

    Attributes:
        name: What it is called in messages.
    """

    name: str

    def open(self) -> None:
        """Open it; raises OSError."""
        ...

    def read(self) -> list[Chunk] | None:
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

    def read(self) -> list[Chunk] | None:
        """See `Wire.read`."""
        ready, _, _ = select.select([self._fd], [], [], _WAKE_S)
        if not ready:
            return []
        data = os.read(self._fd, _CHUNK)
        return [Chunk(data)] if data else None

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

    @property
    def on_all_interfaces(self) -> bool:
        """Whether any computer in the network can send."""
        return self._address[0] == "0.0.0.0"

    def open(self) -> None:
        """See `Wire.open`."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(self._address)
        except OSError:
            self._socket.close()
            raise

    def read(self) -> list[Chunk] | None:
        """See `Wire.read`."""
        found: list[Chunk] = []
        select.select([self._socket], [], [], _WAKE_S)
        with contextlib.suppress(BlockingIOError):
            while len(found) < _DATAGRAMS:
                data, sender = self._socket.recvfrom(_DATAGRAM)
                found.append(Chunk(data + b"\n", sender))
        return found

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

    def read(self) -> list[Chunk] | None:
        """See `Wire.read`; after the server has gone, tries again until it is back."""
        if self._socket is None:
            threading.Event().wait(_WAKE_S)
            with contextlib.suppress(OSError):
                self.open()
            return []
        try:
            data = self._socket.recv(_CHUNK)
        except TimeoutError:
            return []
        except OSError:
            data = b""
        if not data:
            self.close()
            # Half a line from before belongs to nothing.
            return [Chunk(b"\n")]
        return [Chunk(data)]

    def close(self) -> None:
        """See `Wire.close`."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


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
