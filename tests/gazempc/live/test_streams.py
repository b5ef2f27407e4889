"""Lines from standard input, UDP and TCP: reassembly from any chunks, and recovery after interruptions."""

import socket
import sys
import time

import pytest
from builders.ports import free_port
from builders.wires import Collector, Scripted, SteppedClock, line, numbers, serve

from gazempc.live.clock import RealClock
from gazempc.live.sources.source import SourceError
from gazempc.live.sources.streams import LINE_MAX, LineSource, Senders
from gazempc.live.sources.wires import Chunk, TcpClient, UdpPort, parse_address
from gazempc.loop.events import Event
from gazempc.people.company import Thinking


def test_addresses_are_parsed_or_refused():
    right = {"5005": ("here", 5005), "a.b:1": ("a.b", 1), "::1:9": ("::1", 9), ":7": ("here", 7)}
    assert {text: parse_address("udp:" + text, text, "here") for text in right} == right
    for text in ("", "65536", "host:-1", "host:²"):
        with pytest.raises(SourceError, match="udp:PORT"):
            parse_address("udp:" + text, text, "here")


def read_from(wire, **options):
    """A source read to its end, and its results."""
    source = LineSource(wire, RealClock(), **options)
    source.open()
    return source, Collector(source).until(lambda c: c.source.finished)


def read(chunks, **options):
    return read_from(Scripted(chunks), **options)[1]


@pytest.mark.parametrize(("size", "end"), [(1, None), (64, OSError("gone"))])
def test_lines_are_reassembled_from_any_chunks(size, end):
    text = b"".join(line(k) for k in range(50)) + b"\n\n  \r\nrubbish\n" + line(50) + line(51).strip()
    wire = Scripted([text[i : i + size] for i in range(0, len(text), size)], end)
    source, found = read_from(wire)
    assert numbers(found.sightings) == list(range(52))
    assert len(found.problems) == 1
    assert "a wire, line 51" in found.problems[0]
    assert all(s.arrival_s - s.observation.capture_time_s == pytest.approx(0.01) for s in found.sightings)
    source.close()
    assert wire.closed == 1


def test_cues_are_returned_with_observations():
    found = read([line(1, person_id="cue") + b'{"cue": "thinking", "lasts_s": 1}\n', b'{"cue": "thinking"}\n'])
    assert found.cues == [Thinking(1.0)]
    assert [sighting.observation.person_id for sighting in found.sightings] == ["cue"]
    assert found.problems[0].startswith("a wire, line 3: thinking.lasts_s")


def test_an_endless_line_is_dropped_and_later_lines_are_read():
    long = b"x" * (LINE_MAX + 1)
    found = read([b"x" * 600_000, b"x" * 600_000, b"y\n" + line(1), long + b"\n" + line(2), long, line(9), line(3)])
    assert numbers(found.sightings) == [1, 2, 3]
    assert [text.partition(":")[0] for text in found.problems] == [f"a wire, line {k}" for k in (1, 3, 5)]
    assert all(str(LINE_MAX) in text for text in found.problems)


@pytest.mark.parametrize("wrong", [b"\xff\xfe\x00\n", b"[" * 100_000 + b"\n", b'{"age_s": 1' + 400 * b"0" + b"}\n"])
def test_no_line_stops_the_reader(wrong):
    """Lines after any input are read: otherwise one packet could disable tracking."""
    found = read([line(1), wrong, line(2)])
    assert numbers(found.sightings) == [1, 2]
    assert len(found.problems) == 1


def test_of_a_burst_the_newest_lines_are_read_and_the_rest_counted():
    found = read([b"".join(line(k) for k in range(100))])
    assert numbers(found.sightings) == list(range(36, 100))
    assert [(notice.event, notice.count) for notice in found.notices] == [(Event.OBSERVATIONS_DROPPED, 36)]


ONE, OTHER = ("10.0.0.7", 4000), ("10.0.0.9", 4000)


@pytest.mark.parametrize(("allowed", "used", "stranger"), [([], [0, 3], OTHER), (["10.0.0.8/31"], [1, 4], ONE)])
def test_a_stream_is_bound_to_the_first_allowed_sender_of_an_observation(allowed, used, stranger):
    """Invalid lines do not bind the stream, nor does another port of the same computer."""
    one_again, other_again = (ONE[0], 4001), (OTHER[0], 4001)
    senders = [OTHER, ONE, OTHER, one_again, ONE, OTHER, other_again]
    texts = [b"rubbish\n", *map(line, range(6))]
    found = read([Chunk(*each) for each in zip(texts, senders, strict=True)], senders=Senders(allowed))
    assert numbers(found.sightings) == used
    (notice,) = found.notices
    assert (notice.event, notice.count) == (Event.SENDER_REFUSED, 4)
    assert f"{stranger[0]}:{stranger[1]}" in notice.text


def test_a_silent_sender_stays_bound_for_10_minutes_unless_its_port_closes():
    senders = Senders()
    senders.register(ONE, 10.0)
    assert senders.probe_due(12.9) is None
    assert senders.refusal(OTHER, 609.0)
    assert senders.probe_due(13.1) == ONE
    assert senders.probe_due(14.0) is None  # at a bounded rate
    assert senders.refusal(ONE, 609.0) == senders.refusal(OTHER, 611.0) == ""
    senders.release(OTHER)
    assert senders.refusal(OTHER, 20.0)
    senders.release(ONE)
    assert senders.refusal(OTHER, 20.0) == ""
    with pytest.raises(SourceError, match="--allow nobody"):
        Senders(["nobody"])


def test_udp_lines_of_a_tracker_that_pauses_and_of_the_next_one():
    clock, port = SteppedClock(), free_port(socket.SOCK_DGRAM)
    source = LineSource(UdpPort("127.0.0.1", port), clock)
    source.open()
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tracker:
        # With and without line end, several in one datagram, and a truncated one, which is not joined to the next.
        for datagram in (line(0), line(1).strip(), line(2) + line(3), line(4)[:20], line(5)):
            tracker.sendto(datagram, ("127.0.0.1", port))
        found = Collector(source).until(lambda c: numbers(c.sightings) == [0, 1, 2, 3, 5])
        (problem,) = found.problems
        assert f"UDP 127.0.0.1:{port}" in problem
        clock.ahead_s = 60.0  # no person in view
        for _ in range(20):
            stranger.sendto(line(9), ("127.0.0.1", port))
            time.sleep(0.01)
        found.until(lambda c: sum(n.count for n in c.notices) == 20)
        tracker.sendto(line(6), ("127.0.0.1", port))
        found.until(lambda c: numbers(c.sightings)[-1] == 6)
    clock.ahead_s = 120.0

    def rebound(collector):
        stranger.sendto(line(7), ("127.0.0.1", port))
        return 7 in numbers(collector.sightings)

    if sys.platform == "linux":  # reports closed ports
        found.until(rebound)  # a restarted tracker has another port
    stranger.close()
    with pytest.raises(SourceError, match=f"UDP 127.0.0.1:{port}"):
        LineSource(UdpPort("127.0.0.1", port), clock).open()
    assert not source.finished
    source.close()
    again = LineSource(UdpPort("127.0.0.1", port), clock)  # the port is free again
    again.open()
    again.close()


def test_queued_datagrams_are_sorted_by_time():
    ages_s = [0.5, 0.4, 0.2, 0.3, 0.1]
    found = read([b"".join(line(k, age_s=age_s) for k, age_s in enumerate(ages_s))])
    assert numbers(found.sightings) == [0, 1, 3, 2, 4]


@pytest.mark.parametrize(
    ("host", "allowed", "warned"), [("0.0.0.0", [], True), ("0.0.0.0", ["127.0.0.1"], True), ("localhost", [], False)]
)
def test_listening_beyond_the_loopback_gives_a_warning(host, allowed, warned):
    source = LineSource(UdpPort(host, free_port(socket.SOCK_DGRAM)), RealClock(), senders=Senders(allowed))
    source.open()
    assert [(n.event, n.count) for n in source.poll().notices] == ([(Event.OPEN_TO_ALL, 0)] if warned else [])
    source.close()


def test_tcp_reconnects_when_the_server_returns():
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
        # The connection ends within a line; the rest of the line never arrives.
        connection, _ = server.accept()
        with connection:
            connection.sendall(line(4) + line(5))
            found.until(lambda c: numbers(c.sightings) == [0, 1, 2, 4, 5])
            assert len(found.problems) == 1
            assert "line 4: Invalid JSON" in found.problems[0]
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
