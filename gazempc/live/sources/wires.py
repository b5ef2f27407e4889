"""Bytes from standard input, UDP or TCP."""

from __future__ import annotations

import contextlib
import errno
import ipaddress
import os
import select
import socket
import struct
import sys
import threading
from typing import NamedTuple, Protocol

from gazempc.live.sources.source import SourceError

Address = tuple[str, int]
_CHUNK = 16_384
_DATAGRAM = 65_536
# Datagrams received at once: empties the system's buffer, so that the newest are included.
_DATAGRAMS = 256
# Socket option of <linux/in.h>: ICMP errors are queued for the socket.
_IP_RECVERR, _REPORTS_CLOSED = 11, hasattr(socket, "MSG_ERRQUEUE")
LOOPBACK = ("127.0.0.1", "localhost")
# Period of a reader's check for its end, and of connection attempts.
_WAKE_S = 0.2


class Chunk(NamedTuple):
    """Bytes received at once.

    Attributes:
        data: The bytes; empty for a datagram sender with a closed port.
        sender: Address and port of the sender; None for a connection.
    """

    data: bytes
    sender: Address | None = None


class Wire(Protocol):
    """A byte stream.

    Attributes:
        name: Name in messages.
    """

    name: str

    def open(self) -> None:
        """Open it; raises OSError."""

    def read(self) -> list[Chunk] | None:
        """Wait briefly for bytes; empty after a timeout, None after the end."""

    def close(self) -> None:
        """Close it."""


def named(host: str) -> str:
    """Host name of this computer for a server at all its addresses; else the address itself."""
    return socket.gethostname() if host == "0.0.0.0" else host


def is_loopback(host: str) -> bool:
    """Whether an address, name or abbreviation (127.1) is reachable from this computer only."""
    return ipaddress.ip_address(socket.gethostbyname(host)).is_loopback


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
        host: Local address.
        port: Port.
    """

    def __init__(self, host: str, port: int) -> None:
        self.name = f"UDP {host}:{port}"
        self._address = (host, port)

    @property
    def on_loopback(self) -> bool:
        """Whether only programs on this computer can send."""
        return is_loopback(self._address[0])

    def open(self) -> None:
        """See `Wire.open`."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        if _REPORTS_CLOSED:
            self._socket.setsockopt(socket.IPPROTO_IP, _IP_RECVERR, 1)
        try:
            self._socket.bind(self._address)
        except OSError:
            self._socket.close()
            raise

    def read(self) -> list[Chunk] | None:
        """See `Wire.read`."""
        found: list[Chunk] = []
        select.select([self._socket], [], [], _WAKE_S)
        # Errors of unanswered probes are also raised here; the port itself remains open until closed.
        with contextlib.suppress(OSError):
            while _REPORTS_CLOSED:
                _, reports, _, asked = self._socket.recvmsg(1, 512, socket.MSG_ERRQUEUE)
                if any(struct.unpack_from("=I", report)[0] == errno.ECONNREFUSED for _, _, report in reports):
                    found.append(Chunk(b"", asked))
        with contextlib.suppress(OSError):
            while len(found) < _DATAGRAMS:
                data, sender = self._socket.recvfrom(_DATAGRAM)
                found.append(Chunk(data + b"\n", sender))
        return found

    def probe(self, sender: Address) -> None:
        """Probe a sender by an empty line: for a closed port its system replies by ICMP, which Linux reports.

        Args:
            sender: Address and port.
        """
        with contextlib.suppress(OSError):
            self._socket.sendto(b"\n", sender)

    def close(self) -> None:
        """See `Wire.close`."""
        self._socket.close()


class TcpClient:
    """A connection to a server of lines, with reconnection.

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
        """See `Wire.read`; reconnects after a loss of the server."""
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
            # Terminates an incomplete line of the lost connection.
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
        text: The part after the kind of source.
        default_host: Default host.

    Returns:
        Host and port.

    Raises:
        SourceError: If it is neither.
    """
    host, _, port = text.rpartition(":")
    if not (port.isdecimal() and 0 < int(port) < 65536):
        raise SourceError(f"{word}: no port; accepted: udp:PORT, udp:HOST:PORT, tcp:HOST:PORT, ports 1 to 65535")
    return host or default_host, int(port)
