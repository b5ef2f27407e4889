"""Who may send datagrams: one sender at a time, told apart by address and port."""

from __future__ import annotations

import ipaddress
import math
from collections.abc import Sequence

from gazempc.live.sources.source import SourceError

Address = tuple[str, int]
# Trackers are silent without a person in view, so silence alone frees the place only where the system of the sender
# cannot report a closed port any more (power, network): after longer than people usually stay away.
_SILENCE_S = 600.0
# A closed port is asked for only after a silence in which frames of a visible person would have come.
_ASKED_AFTER_S = 3.0


class Senders:
    """Keeps to the sender whose line was the first to be an observation, until its port is closed or it is silent.

    Args:
        allowed: Addresses or networks, such as ``192.168.0.7`` or ``192.168.0.0/24``; only these may
            send. Empty: any.

    Raises:
        SourceError: If one is no address.
    """

    def __init__(self, allowed: Sequence[str] = ()) -> None:
        self._allowed = [_network(word) for word in allowed]
        self._first: Address | None = None
        self._heard_s = self._asked_s = -math.inf

    def refusal(self, sender: Address, now_s: float) -> str:
        """Why a datagram is not read.

        Args:
            sender: Address and port that it came from.
            now_s: The time, seconds.

        Returns:
            A sentence; empty if it is read.
        """
        host, port = sender
        first = self._first
        if sender == first:
            return ""
        if self._allowed and not any(ipaddress.ip_address(host) in network for network in self._allowed):
            return f"lines of {host}:{port} are not read: --allow names others"
        if first is None or now_s - self._heard_s > _SILENCE_S:
            return ""
        return (
            f"lines of {host}:{port} are not read: {first[0]}:{first[1]} was first, and keeps its place until its port "
            f"is closed or it is silent for {_SILENCE_S / 60:.0f} minutes; give a second tracker a port of its own"
        )

    def heard(self, sender: Address, now_s: float) -> None:
        """Take note that a sender's line is an observation.

        Args:
            sender: Address and port.
            now_s: The time, seconds.
        """
        self._first, self._heard_s = sender, now_s

    def to_ask(self, now_s: float) -> Address | None:
        """The silent sender, if it is to be asked, once in three seconds, whether its port is open.

        Args:
            now_s: The time, seconds.
        """
        if self._first is None or now_s - max(self._heard_s, self._asked_s) < _ASKED_AFTER_S:
            return None
        self._asked_s = now_s
        return self._first

    def closed(self, sender: Address) -> None:
        """Take note that a sender's port is closed: its place is free.

        Args:
            sender: Address and port.
        """
        if sender == self._first:
            self._first = None


def _network(word: str) -> ipaddress.IPv4Network | ipaddress.IPv6Network:
    try:
        return ipaddress.ip_network(word, strict=False)
    except ValueError:
        raise SourceError(
            f"--allow {word}: not an address; accepted: addresses such as 192.168.0.7, networks such as 192.168.0.0/24"
        ) from None
