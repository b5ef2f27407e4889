"""Lines from standard input, UDP and TCP: put together however they are cut, and back after every interruption."""

import json
import socket
import time

import pytest
from builders.lines import FOREVER_S
from builders.ports import free_port

from gazempc.live.clock import RealClock
from gazempc.live.sources.json_lines import LineError
from gazempc.live.sources.senders import Senders, Signatures, read_key, signed_line
from gazempc.live.sources.source import SourceError
from gazempc.live.sources.streams import LINE_MAX, Chunk, LineSource, StandardInput, TcpClient, UdpPort, parse_address
from gazempc.loop.events import Event


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
        self.source, self.sightings, self.problems, self.notices = source, [], [], []

    def until(self, done):
        until_s = time.monotonic() + FOREVER_S
        while not done(self):
            arrived = self.source.poll()
            self.sightings += arrived.sightings
            self.problems += arrived.problems
            self.notices += arrived.notices
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
            chunk = self.chunks.pop(0)
            return [chunk if isinstance(chunk, Chunk) else Chunk(chunk)]
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
    long = b"x" * (LINE_MAX + 1)
    wire = Scripted([b"x" * 600_000, b"x" * 600_000, b"y\n" + line(1), long + b"\n" + line(2), long, line(9), line(3)])
    source = LineSource(wire, RealClock())
    source.open()
    found = Collector(source).until(lambda c: c.source.finished)
    assert numbers(found.sightings) == [1, 2, 3]
    assert [text.partition(":")[0] for text in found.problems] == [f"a wire, line {k}" for k in (1, 3, 5)]
    assert all(f"longer than {LINE_MAX} bytes" in text for text in found.problems)
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


def test_of_lines_that_come_at_once_the_newest_are_read_and_the_others_counted():
    source = LineSource(Scripted([b"".join(line(k) for k in range(100))]), RealClock())
    source.open()
    found = Collector(source).until(lambda c: c.source.finished)
    assert numbers(found.sightings) == list(range(36, 100))
    assert [(notice.event, notice.count) for notice in found.notices] == [(Event.OBSERVATIONS_DROPPED, 36)]


ONE, OTHER = ("10.0.0.7", 4000), ("10.0.0.9", 4000)


def read(chunks, **options):
    source = LineSource(Scripted(chunks), RealClock(), **options)
    source.open()
    return Collector(source).until(lambda c: c.source.finished)


def test_a_stream_belongs_to_who_sent_the_first_observation():
    """Rubbish takes it from nobody, and neither does the same computer from another port."""
    again = (ONE[0], 4001)
    sent = [(b"rubbish\n", OTHER), (line(0), ONE), (line(1), OTHER), (line(2), again), (line(3), ONE)]
    found = read([Chunk(*each) for each in sent])
    assert numbers(found.sightings) == [0, 3]
    (notice,) = found.notices
    assert (notice.event, notice.count) == (Event.SENDER_REFUSED, 2)
    assert notice.text.startswith("lines of 10.0.0.9:4000 are not read: 10.0.0.7:4000 was first")
    assert "--allow 10.0.0.9" in notice.text


def test_after_a_silence_somebody_else_is_heard():
    senders = Senders()
    senders.heard(ONE, 10.0)
    assert senders.refusal(OTHER, 12.9)
    assert senders.refusal(ONE, 12.9) == senders.refusal(OTHER, 13.1) == ""


@pytest.mark.parametrize("allowed", ["10.0.0.9", "10.0.0.8/31"])
def test_only_who_is_allowed_is_read(allowed):
    found = read([Chunk(line(0), ONE), Chunk(line(1), OTHER)], senders=Senders([allowed]))
    assert numbers(found.sightings) == [1]
    assert "lines of 10.0.0.7:4000 are not read" in found.notices[0].text
    with pytest.raises(SourceError, match=r"--allow nobody: not an address; accepted: .*192\.168"):
        Senders(["nobody"])


KEY = b"a shared key of some length"


def test_only_lines_that_are_signed_with_the_key_are_read_and_each_once():
    now_s = time.time()
    good, body = [signed_line(line(k).strip(), KEY, now_s + 0.01 * k) for k in range(3)], line(9).strip()
    changed = good[2].replace(b"2.0", b"2.5")
    old = signed_line(body, KEY, now_s - 60.0)
    sent = [good[0], body, signed_line(body, b"another key of the length"), changed, old, good[0], good[1]]
    found = read([each + b"\n" for each in sent], signatures=Signatures(KEY))
    assert numbers(found.sightings) == [0, 1]
    assert [(notice.event, notice.count) for notice in found.notices] == [(Event.SENDER_REFUSED, 5)]
    assert "line 2: not signed" in found.notices[0].text


@pytest.mark.parametrize(
    ("sent_s", "body", "why"),
    [
        (-60.0, "{}", "60 s before now: an old line"),
        (90.0, "{}", "90 s ahead of now"),
        (0.0, "{}", "sent again"),
        (0.5, "{} ", "changed on its way"),
    ],
)
def test_why_a_signature_is_refused(sent_s, body, why):
    now_s, signatures = time.time(), Signatures(KEY)
    signatures.body(signed_line(b"{}", KEY, now_s))
    signed = signed_line(b"{}", KEY, now_s + sent_s).replace(b"{}", body.replace(" ", "x").encode())
    with pytest.raises(LineError, match=why):
        signatures.body(signed)


def test_a_key_is_read_from_a_file(tmp_path):
    path = tmp_path / "key"
    path.write_bytes(KEY + b"\n")
    assert read_key(path) == KEY
    for content in (b"short", b"x" * 2000):
        path.write_bytes(content)
        with pytest.raises(SourceError, match="16 to 1024"):
            read_key(path)
    with pytest.raises(SourceError, match="no such file"):
        read_key(tmp_path)


@pytest.mark.parametrize(("host", "warned"), [("0.0.0.0", True), ("127.0.0.1", False)])
def test_who_listens_on_all_interfaces_is_warned(host, warned):
    source = LineSource(UdpPort(host, free_port(socket.SOCK_DGRAM)), RealClock())
    source.open()
    assert [(n.event, n.count) for n in source.poll().notices] == ([(Event.OPEN_TO_ALL, 0)] if warned else [])
    source.close()
    narrowed = LineSource(UdpPort(host, free_port(socket.SOCK_DGRAM)), RealClock(), senders=Senders(["127.0.0.1"]))
    narrowed.open()
    assert narrowed.poll().notices == ()
    narrowed.close()


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
