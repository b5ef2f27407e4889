"""Whose datagrams count: the first sender's, or those of addresses that are told."""

from __future__ import annotations

import ipaddress
import math
from collections.abc import Sequence

from gazempc.live.sources.source import SourceError

Address = tuple[str, int]
# A tracker that was started again has another port, and is heard after so long; a person is often away for a second.
_SILENCE_S = 3.0


class Senders:
    """Keeps to the sender whose line was the first to be an observation, until it has been silent for 3 s.

    Args:
        allowed: Addresses or networks, such as ``192.168.0.7`` or ``192.168.0.0/24``; whoever is in them may send, and
            nobody else. Empty: the first sender.
        keyed: Whether lines are signed: then the key says who may send, wherever it is.

    Raises:
        SourceError: If one is no address.
    """

    def __init__(self, allowed: Sequence[str] = (), keyed: bool = False) -> None:
        self._allowed = [_network(word) for word in allowed]
        self._anybody = keyed
        self._first: Address | None = None
        self._heard_s = -math.inf

    @property
    def open_to_all(self) -> bool:
        """Whether the first who sends is obeyed, whoever that is."""
        return not self._allowed and not self._anybody

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
        if self._anybody or first is None or first == sender or now_s - self._heard_s > _SILENCE_S:
            return ""
        first_host, first_port = first
        return (
            f"lines of {host}:{port} are not read: {first_host}:{first_port} was first, and sends still; "
            f"say --allow {host} if both may"
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
