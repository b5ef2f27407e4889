"""Lines of JSON from standard input, UDP or TCP, read and parsed in a separate thread."""

from __future__ import annotations

import ipaddress
import math
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from functools import partial

from gazempc.live.clock import Clock
from gazempc.live.sources.json_lines import LineError, is_cue, parse_cue, parse_line
from gazempc.live.sources.source import Arrived, Notice, SourceError
from gazempc.live.sources.wires import Address, Chunk, UdpPort, Wire
from gazempc.live.stamps import StampReader, Stamps
from gazempc.loop.events import Event
from gazempc.people.company import Cue
from gazempc.types import Sighting
from predictors import HeadObservation

# Timeout of the lock on a sender whose system cannot report a closed port (power, network); longer than usual absences
# of people, as trackers are silent without a person in view.
_SILENCE_S = 600.0
# Silence before a sender's port is probed; longer than the frame interval with a person in view.
_ASKED_AFTER_S = 3.0


class Senders:
    """Locks on to the first sender of a valid observation, until its port is closed or it times out.

    Args:
        allowed: Addresses or networks, such as ``192.168.0.7`` or ``192.168.0.0/24``; only these may
            send. Empty: any.

    Raises:
        SourceError: If one is not an address.
    """

    def __init__(self, allowed: Sequence[str] = ()) -> None:
        self._allowed = [_network(word) for word in allowed]
        self._first: Address | None = None
        self._heard_s = self._asked_s = -math.inf

    def refusal(self, sender: Address, now_s: float) -> str:
        """Reason to refuse a datagram.

        Args:
            sender: Address and port of the sender.
            now_s: The time, seconds.

        Returns:
            A sentence; empty for an accepted datagram.
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
            f"lines of {host}:{port} are not read: {first[0]}:{first[1]} was first, and is read until its port "
            f"is closed or it is silent for {_SILENCE_S / 60:.0f} minutes; use a separate port for a second tracker"
        )

    def register(self, sender: Address, now_s: float) -> None:
        """Register a valid observation of a sender.

        Args:
            sender: Address and port.
            now_s: The time, seconds.
        """
        self._first, self._heard_s = sender, now_s

    def probe_due(self, now_s: float) -> Address | None:
        """The silent sender, if its port is due for a probe, once in three seconds.

        Args:
            now_s: The time, seconds.
        """
        if self._first is None or now_s - max(self._heard_s, self._asked_s) < _ASKED_AFTER_S:
            return None
        self._asked_s = now_s
        return self._first

    def release(self, sender: Address) -> None:
        """Release the lock of a sender whose port is closed.

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


# Length of the queue, more than a second of a fast tracker; without polls the oldest are dropped.
_WAITING_MAX = 1024
# Number of stored texts of invalid lines between two polls; others are counted.
_TEXTS_KEPT = 20
# Maximum length of a line, five times that of a complete observation; parsing more would delay other threads.
LINE_MAX = 4096
# Maximum number of lines parsed from one burst, the newest; more than the people of a frame.
_LINES_MAX = 64
# Number of lines after which the thread yields for the duration of their parsing.
_MANY_LINES = 16


class LineSource:
    """Reads lines in a separate thread and parses them as in `gazempc.live.sources.json_lines`.

    Args:
        wire: Byte stream of the lines.
        clock: The loop's clock.
        stamps: Reader of capture times; default: Unix time in seconds.
        senders: Filter of datagrams; default: the first sender only.
    """

    def __init__(
        self, wire: Wire, clock: Clock, stamps: StampReader | None = None, senders: Senders | None = None
    ) -> None:
        self._wire, self._clock = wire, clock
        self._stamps = stamps or StampReader(Stamps(), clock)
        self._senders = senders or Senders()
        self._lines, self._rest = 0, b""
        self._ended, self._closing = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name="source", daemon=True)
        # Guards all below; held for a few microseconds at most.
        self._lock = threading.Lock()
        self._arrived: deque[Sighting] = deque(maxlen=_WAITING_MAX)
        self._cues: deque[Cue] = deque(maxlen=_WAITING_MAX)
        self._problems: list[str] = []
        # By event: first text and number of observations.
        self._notices: dict[Event, tuple[str, int]] = {}

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`."""
        try:
            self._wire.open()
        except (OSError, AttributeError, ValueError) as error:  # the last two: standard input is closed
            why = getattr(error, "strerror", None) or error
            raise SourceError(f"{self._wire.name}: cannot be opened: {why}") from None
        if isinstance(self._wire, UdpPort) and not self._wire.on_loopback:
            text = (
                f"{self._wire.name} can be reached from the network, lines are neither encrypted nor signed, and "
                "addresses can be forged: who reaches the port can turn the head; use the loopback and a tunnel"
            )
            self._note(Event.OPEN_TO_ALL, text, 0)
        self._thread.start()

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        with self._lock:
            sightings, problems, cues = tuple(self._arrived), tuple(self._problems), tuple(self._cues)
            notices = tuple(Notice(event, *each) for event, each in self._notices.items())
            for queue in (self._arrived, self._problems, self._cues, self._notices):
                queue.clear()
        # Datagrams may arrive out of order.
        in_order = sorted(sightings, key=lambda each: each.observation.capture_time_s)
        return Arrived(tuple(in_order), problems, notices, cues)

    @property
    def finished(self) -> bool:
        """See `gazempc.live.sources.source.Source.finished`."""
        with self._lock:
            return self._ended.is_set() and not (self._arrived or self._problems or self._notices)

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)

    def _work(self) -> None:
        try:
            while not self._closing.is_set() and (chunks := self._read()) is not None:
                self._take(chunks)
            self._take([Chunk(b"\n")])
        finally:
            self._wire.close()
            self._ended.set()

    def _read(self) -> list[Chunk] | None:
        with suppress(OSError):
            return self._wire.read()
        return None

    def _take(self, chunks: list[Chunk]) -> None:
        now_s = self._clock.now_s()
        lines: list[tuple[bytes, Address | None]] = []
        for data, sender in chunks:
            if sender is not None and not data:
                self._senders.release(sender)
            elif not self._refused(sender, now_s):
                lines += [(line, sender) for line in self._cut(data)]
        if (older := len(lines) - _LINES_MAX) > 0:
            self._note(Event.OBSERVATIONS_DROPPED, "more lines arrived at once than can be parsed", older)
            self._lines += older
        started_s = time.perf_counter()
        for line, sender in lines[-_LINES_MAX:]:
            self._lines += 1
            # Checked again: the first sender may be among these chunks.
            if not self._refused(sender, now_s):
                self._parse(line, sender, now_s)
        if len(lines) > _MANY_LINES:
            self._closing.wait(time.perf_counter() - started_s)

    def _refused(self, sender: Address | None, now_s: float) -> bool:
        why = "" if sender is None else self._senders.refusal(sender, now_s)
        if why:
            self._note(Event.SENDER_REFUSED, why)
            if isinstance(self._wire, UdpPort) and (silent := self._senders.probe_due(now_s)):
                self._wire.probe(silent)
        return bool(why)

    def _cut(self, data: bytes) -> list[bytes]:
        """Complete lines; longer ones than the limit are discarded."""
        is_known = len(self._rest) > LINE_MAX
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[: LINE_MAX + 1]  # of a longer line only its length matters
        for _ in range(sum(len(line) > LINE_MAX for line in (*lines, rest)) - is_known):
            self._lines += 1
            self._problem(f"longer than {LINE_MAX} bytes")
        return [line for line in lines if len(line) <= LINE_MAX and line.strip()]

    def _parse(self, line: bytes, sender: Address | None, arrival_s: float) -> None:
        text, to_loop_s = line.decode("utf-8", errors="replace"), partial(self._stamps.loop_s, arrival_s=arrival_s)
        try:
            found = parse_cue(text, arrival_s) if is_cue(text) else parse_line(text, arrival_s, to_loop_s)
        except LineError as error:
            self._problem(str(error))
            return
        if sender is not None:
            self._senders.register(sender, arrival_s)
        with self._lock:
            full = isinstance(found, HeadObservation) and len(self._arrived) == _WAITING_MAX
            if isinstance(found, HeadObservation):
                self._arrived.append(Sighting(arrival_s, found))
            else:
                self._cues.append(found)
        if full:
            self._note(Event.OBSERVATIONS_DROPPED, "the queue of observations is full")

    def _problem(self, why: str) -> None:
        text = f"{self._wire.name}, line {self._lines}: {why}"
        with self._lock:
            if kept := len(self._problems) < _TEXTS_KEPT:
                self._problems.append(text)
        if not kept:
            self._note(Event.BAD_OBSERVATION, text)

    def _note(self, event: Event, text: str, count: int = 1) -> None:
        with self._lock:
            first, before = self._notices.get(event, (text, 0))
            self._notices[event] = first, before + count
