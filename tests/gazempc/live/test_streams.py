"""Lines from standard input, UDP and TCP: put together however they are cut, and back after every interruption."""

import json
import queue
import socket
import time

import pytest
from builders.lines import FOREVER_S
from builders.ports import free_port

from gazempc.live.clock import RealClock
from gazempc.live.sources.source import SourceError
from gazempc.live.sources.streams import LineSource, StandardInput, TcpClient, UdpPort, parse_address


@pytest.mark.parametrize(
    ("text", "expected"), [("5005", ("here", 5005)), ("a.b:1", ("a.b", 1)), ("::1:9", ("::1", 9)), (":7", ("here", 7))]
)
def test_addresses(text, expected):
    assert parse_address("udp:" + text, text, "here") == expected


@pytest.mark.parametrize("text", ["", "0", "65536", "http", "host:", "host:-1", "1.5", "host:²"])
def test_wrong_addresses_are_refused(text):
    with pytest.raises(SourceError, match="udp:PORT"):
        parse_address("udp:" + text, text, "here")


def line(k, **other):
    return json.dumps({"age_s": 0.01, "head_position_m": [2.0, 0.001 * k, 0.4]} | other).encode() + b"\n"


def numbers(sightings):
    return [round(1000 * s.observation.head_position_base_m[1]) for s in sightings]


class Collector:
    """Polls a source until enough has come."""

    def __init__(self, source):
        self.source, self.sightings, self.problems = source, [], []

    def until(self, done):
        until_s = time.monotonic() + FOREVER_S
        while not done(self):
            arrived = self.source.poll()
            self.sightings += arrived.sightings
            self.problems += arrived.problems
            assert time.monotonic() < until_s, (numbers(self.sightings), self.problems)
            time.sleep(0.001)
        return self


class Scripted:
    """A wire that gives prepared chunks; None at the end, or OSError."""

    name = "a wire"

    def __init__(self, chunks, end=None):
        self.chunks, self.end, self.closed = list(chunks), end, 0

    def open(self):
        pass

    def read(self):
        if self.chunks:
            return self.chunks.pop(0)
        if self.end is not None:
            raise self.end
        return None

    def close(self):
        self.closed += 1


@pytest.mark.parametrize("end", [None, OSError("gone")])
@pytest.mark.parametrize("size", [1, 7, 64, 10_000])
def test_lines_are_put_together_however_they_are_cut(size, end):
    clock = RealClock()
    text = b"".join(line(k) for k in range(50)) + b"\n\n  \r\nrubbish\n" + line(50) + line(51).strip()
    wire = Scripted([text[i : i + size] for i in range(0, len(text), size)], end)
    source = LineSource(wire, clock)
    source.open()
    found = Collector(source).until(lambda c: c.source.finished)
    assert numbers(found.sightings) == list(range(52))
    assert len(found.problems) == 1
    assert "a wire, line 51: not JSON" in found.problems[0]
    assert all(s.arrival_s - s.observation.capture_time_s == pytest.approx(0.01) for s in found.sightings)
    assert all(0 <= s.arrival_s <= clock.now_s() for s in found.sightings)
    source.close()
    assert wire.closed == 1


def test_a_line_without_end_is_given_up_and_the_next_ones_are_read():
    wire = Scripted([b"x" * 600_000, b"x" * 600_000, b"y\n" + line(1)])
    source = LineSource(wire, RealClock())
    source.open()
    found = Collector(source).until(lambda c: c.source.finished)
    assert numbers(found.sightings) == [1]
    assert "longer than" in found.problems[0]
    source.close()


@pytest.mark.parametrize(
    "wrong",
    [
        b'{"age_s": 1' + 400 * b"0" + b', "head_position_m": [2, 0, 0]}\n',
        b'{"age_s": 0.1, "head_position_m": [1' + 400 * b"0" + b", 0, 0]}\n",
        b"\xff\xfe\x00\n",
        b"[" * 100_000 + b"\n",
        b'{"age_s": 0.1, "head_position_m": "\\ud800"}\n',
    ],
)
def test_no_line_ends_the_reading(wrong):
    """Whatever is sent, the lines after it are read: otherwise one packet could blind the robot for good."""
    source = LineSource(Scripted([line(1), wrong, line(2)]), RealClock())
    source.open()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("threading.excepthook", lambda arguments: None)
        source._thread.join(FOREVER_S)
    arrived = source.poll()
    assert numbers(arrived.sightings) == [1, 2]
    assert len(arrived.problems) == 1
    source.close()


def test_if_nobody_polls_the_oldest_are_lost():
    source = LineSource(Scripted([line(k) for k in range(3000)]), RealClock())
    source.open()
    source._thread.join(FOREVER_S)
    found = numbers(source.poll().sightings)
    assert found == list(range(3000 - len(found), 3000))
    assert 100 < len(found) < 3000
    source.close()


def test_what_is_thrown_away_while_it_is_polled_is_no_error():
    """The reader makes room in a full queue at the very moment at which the loop empties it."""

    class Racing(queue.Queue):
        def qsize(self):
            return super().qsize() + 1

    source = LineSource(Scripted([]), RealClock())
    source._arrived = Racing()
    source._arrived.put("a problem")
    assert source.poll().problems == ("a problem",)


def test_udp():
    port = free_port(socket.SOCK_DGRAM)
    source = LineSource(UdpPort("127.0.0.1", port), RealClock())
    source.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        # With and without an end of line, several in one, and one that is cut: it is not glued to the next.
        for datagram in (line(0), line(1).strip(), line(2) + line(3), line(4)[:20], line(5)):
            sender.sendto(datagram, ("127.0.0.1", port))
        found = Collector(source).until(lambda c: len(c.sightings) >= 5)
    assert numbers(found.sightings) == [0, 1, 2, 3, 5]
    assert len(found.problems) == 1
    assert f"UDP 127.0.0.1:{port}" in found.problems[0]
    assert not source.finished
    second = LineSource(UdpPort("127.0.0.1", port), RealClock())
    with pytest.raises(SourceError, match=f"UDP 127.0.0.1:{port}: cannot be opened"):
        second.open()
    second._wire.close()
    source.close()
    assert not source._thread.is_alive()
    again = LineSource(UdpPort("127.0.0.1", port), RealClock())  # the port is free again
    again.open()
    again.close()


def serve(port):
    server = socket.socket()
    server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    server.bind(("127.0.0.1", port))
    server.listen()
    server.settimeout(FOREVER_S)
    return server


def test_tcp_when_the_server_goes_away_and_comes_back():
    port = free_port()
    clock = RealClock()
    with pytest.raises(SourceError, match=f"TCP 127.0.0.1:{port}: cannot be opened"):
        LineSource(TcpClient("127.0.0.1", port), clock).open()
    source = LineSource(TcpClient("127.0.0.1", port), clock)
    with serve(port) as server:
        source.open()
        connection, _ = server.accept()
        with connection:
            connection.sendall(line(0) + line(1)[:10])
            found = Collector(source).until(lambda c: numbers(c.sightings) == [0])
            connection.sendall(line(1)[10:] + line(2) + line(3)[:25])
            found.until(lambda c: numbers(c.sightings) == [0, 1, 2])
        # It breaks off in the middle of a line; the rest of that line never comes.
        connection, _ = server.accept()
        with connection:
            connection.sendall(line(4) + line(5))
            found.until(lambda c: numbers(c.sightings) == [0, 1, 2, 4, 5])
            assert len(found.problems) == 1
            assert "line 4: not JSON" in found.problems[0]
            # A reset instead of an end.
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    with serve(port) as server:
        connection, _ = server.accept()
        with connection:
            connection.sendall(line(6))
            found.until(lambda c: numbers(c.sightings)[-1] == 6)
    assert not source.finished
    source.close()
    assert not source._thread.is_alive()


def test_a_source_may_be_closed_before_it_is_opened_and_twice():
    for wire in (UdpPort("127.0.0.1", free_port(socket.SOCK_DGRAM)), TcpClient("127.0.0.1", 1), StandardInput()):
        source = LineSource(wire, RealClock())
        source.close()
        source.close()
