"""Who may send: the first sender, addresses that are allowed, or holders of a shared key."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import math
import time
from collections.abc import Sequence
from pathlib import Path

from gazempc.live.sources.json_lines import LineError
from gazempc.live.sources.source import SourceError

Address = tuple[str, int]
# A tracker that was started again has another port, and is heard after so long; a person is often away for a second.
_SILENCE_S = 3.0


class Senders:
    """Keeps to the sender whose line was the first to be an observation, until it has been silent for 3 s.

    Args:
        allowed: Addresses or networks, such as ``192.168.0.7`` or ``192.168.0.0/24``; only these may
            send. Empty: the first sender.
        keyed: Whether lines are signed: then any address may send that has the key.

    Raises:
        SourceError: If one is no address.
    """

    def __init__(self, allowed: Sequence[str] = (), keyed: bool = False) -> None:
        self._allowed = [_network(word) for word in allowed]
        self._keyed = keyed
        self._first: Address | None = None
        self._heard_s = -math.inf

    @property
    def open_to_all(self) -> bool:
        """Whether any first sender is accepted."""
        return not self._allowed and not self._keyed

    def refusal(self, sender: Address, now_s: float) -> str:
        """Why a datagram is not read.

        Args:
            sender: Address and port that it came from.
            now_s: The time, seconds.

        Returns:
            A sentence; empty if it is read.
        """
        host, port = sender
        if self._allowed:
            address = ipaddress.ip_address(host)
            if any(address in network for network in self._allowed):
                return ""
            return f"lines of {host}:{port} are not read: --allow names others"
        first = self._first
        if self._keyed or first is None or first == sender or now_s - self._heard_s > _SILENCE_S:
            return ""
        first_host, first_port = first
        return (
            f"lines of {host}:{port} are not read: {first_host}:{first_port} was first, and sends still; "
            f"set --allow {host} if both may send"
        )

    def heard(self, sender: Address, now_s: float) -> None:
        """Take note that a sender's line is an observation.

        Args:
            sender: Address and port.
            now_s: The time, seconds.
        """
        self._first, self._heard_s = sender, now_s


def _network(word: str) -> ipaddress.IPv4Network | ipaddress.IPv6Network:
    try:
        return ipaddress.ip_network(word, strict=False)
    except ValueError:
        raise SourceError(
            f"--allow {word}: not an address; accepted: addresses such as 192.168.0.7, networks such as 192.168.0.0/24"
        ) from None


_SHORTEST_KEY, _LONGEST_KEY = 16, 1024
# Lines of an earlier run are not taken again. Clocks of two computers agree to this without any care.
_SENT_WITHIN_S = 30.0
_PARTS, _MAC_DIGITS = 3, 64


class UnsignedError(LineError):
    """A line is not signed with the key, or was sent before."""


def signed_line(body: bytes, key: bytes, sent_unix_s: float | None = None) -> bytes:
    """Sign a line.

    Args:
        body: The line, a JSON object without an end of line.
        key: The shared key.
        sent_unix_s: Unix time of sending, later than that of the line before; None for now.

    Returns:
        Time, HMAC in hexadecimal digits, and body, separated by single spaces.
    """
    stamp = f"{time.time() if sent_unix_s is None else sent_unix_s:.6f}".encode("ascii")
    return b" ".join((stamp, _mac(key, stamp, body), body))


def read_key(path: Path) -> bytes:
    """Read a shared key: all bytes of a file but white space around them.

    Args:
        path: The file.

    Returns:
        The key.

    Raises:
        SourceError: If it cannot be read, or has fewer than 16 bytes or more than 1024.
    """
    try:
        if not path.is_file():
            raise SourceError(f"--key-file {path}: no such file")
        with path.open("rb") as file:
            key = file.read(_LONGEST_KEY + 1).strip()
    except OSError as error:
        raise SourceError(f"--key-file {path}: cannot be read: {error.strerror}") from None
    if not _SHORTEST_KEY <= len(key) <= _LONGEST_KEY:
        raise SourceError(
            f"--key-file {path}: not a key; accepted: {_SHORTEST_KEY} to {_LONGEST_KEY} bytes, such as those that "
            "`openssl rand -hex 32` gives"
        )
    return key


class Signatures:
    """Takes signatures off lines. Each line must have been sent later than the one before. One thread uses it.

    Args:
        key: The shared key.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._newest_s = -math.inf

    def body(self, line: bytes) -> bytes:
        """The body of a signed line.

        Args:
            line: The line.

        Returns:
            The body.

        Raises:
            UnsignedError: If it is not signed with the key, was sent before, or at another time than about now.
        """
        parts = line.strip().split(b" ", _PARTS - 1)
        if len(parts) != _PARTS or len(parts[1]) != _MAC_DIGITS:
            raise UnsignedError("not signed: with --key-file needed is TIME HMAC {...}")
        stamp, mac, body = parts
        if not hmac.compare_digest(mac, _mac(self._key, stamp, body)):
            raise UnsignedError("signed with another key, or changed on its way")
        try:
            sent_s = float(stamp)
        except ValueError:
            sent_s = math.nan
        off_s = sent_s - time.time()
        if not abs(off_s) <= _SENT_WITHIN_S:
            raise UnsignedError(
                f"signed {abs(off_s):.0f} s {'ahead of' if off_s > 0 else 'before'} now: an old line, or a wrong clock"
            )
        if sent_s <= self._newest_s:
            raise UnsignedError("signed no later than the line before: a line that was sent again")
        self._newest_s = sent_s
        return body


def _mac(key: bytes, stamp: bytes, body: bytes) -> bytes:
    return hmac.new(key, stamp + b" " + body, hashlib.sha256).hexdigest().encode("ascii")
