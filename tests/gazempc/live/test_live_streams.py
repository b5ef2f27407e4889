"""Observations as lines of JSON: what is accepted, and standard input, UDP and TCP end to end."""

import contextlib
import gc
import json
import math
import queue
import select
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gazempc.live import command as live
from gazempc.live.clock import RealClock
from gazempc.live.settings import LiveSettings
from gazempc.live.sources.json_lines import FIELDS, LineError, parse_line
from gazempc.live.sources.source import SourceError
from gazempc.live.sources.streams import LineSource, StandardInput, TcpClient, UdpPort, parse_address
from gazempc.results.limits import limit_violations
from gazempc.results.log import load_log
from gazempc.results.metrics import measure

FOREVER_S = 30.0  # nothing here takes so long, on whatever machine
HEAD = [2.1, 0.3, 0.4]
QUAT = [1.0, 0.0, 0.0, 0.0]


def parse(data, arrival_s=10.0):
    text = data if isinstance(data, str) else json.dumps(data)
    return parse_line(text, arrival_s, lambda unix_s: unix_s - 1000.0)


# --- one line

finite = st.floats(-1e6, 1e6)


@given(
    position=st.lists(finite, min_size=3, max_size=3),
    stamp=st.one_of(
        st.tuples(st.just("capture_time_s"), finite),
        st.tuples(st.just("age_s"), st.floats(0.0, 1e6)),
        st.tuples(st.just("age_s"), st.integers(0, 100)),
    ),
    turns=st.tuples(*[st.none() | st.tuples(*[st.floats(-3.0, 3.0)] * 3)] * 2),
    indent=st.none() | st.just("\t"),
)
def test_what_is_written_is_read(position, stamp, turns, indent):
    quats = [None if t is None else Rotation.from_rotvec(t).as_quat(scalar_first=True).tolist() for t in turns]
    data = {stamp[0]: stamp[1], "head_position_m": position, "head_quat_wxyz": quats[0], "pelvis_quat_wxyz": quats[1]}
    text = json.dumps(data, separators=(",", ":") if indent is None else (" , ", " : "))
    for line in (text, f"  {text}\r"):
        found = parse(line)
        assert found.head_position_base_m.tolist() == position
        for quat, value in zip(quats, (found.head_quat_wxyz, found.pelvis_quat_wxyz), strict=True):
            assert quat == (None if value is None else value.tolist())
        expected_s = stamp[1] - 1000.0 if stamp[0] == "capture_time_s" else 10.0 - stamp[1]
        assert found.capture_time_s == expected_s
    # What may be left out may be left out.
    short = {k: v for k, v in data.items() if v is not None}
    assert parse(short).head_position_base_m.tolist() == position


GOOD = {"age_s": 0.05, "head_position_m": HEAD}


@pytest.mark.parametrize(
    ("line", "named", "accepted"),
    [
        ("", "not JSON", ""),
        ("{", "not JSON", "{"),
        ('{"age_s": 0.05} {}', "not JSON", ""),
        ("[" * 100_000, "not JSON", ""),
        ("9" * 5000, "not JSON", ""),
        ("[1, 2, 3]", "object", "head_position_m"),
        ("3", "object", "age_s"),
        ("null", "object", "age_s"),
        (GOOD | {"head_positon_m": HEAD}, "head_positon_m", "head_position_m"),
        (GOOD | {"yaw": 1}, "yaw", "pelvis_quat_wxyz"),
        ({"age_s": 0.05}, "head_position_m", "metres"),
        ({"age_s": 0.05, "head_position_m": None}, "head_position_m", "metres"),
        ({"head_position_m": HEAD}, "capture_time_s", "age_s"),
        (GOOD | {"capture_time_s": 1.0}, "capture_time_s", "age_s"),
        (GOOD | {"age_s": "0.05"}, "age_s", "number"),
        (GOOD | {"age_s": True}, "age_s", "number"),
        (GOOD | {"age_s": [0.05]}, "age_s", "number"),
        (GOOD | {"age_s": -0.01}, "age_s", "0 or more"),
        ('{"age_s": NaN, "head_position_m": [2, 0, 0]}', "age_s", "number"),
        ('{"age_s": 1e999, "head_position_m": [2, 0, 0]}', "age_s", "number"),
        ('{"capture_time_s": -Infinity, "head_position_m": [2, 0, 0]}', "capture_time_s", "finite"),
        ('{"capture_time_s": 1' + 400 * "0" + ', "head_position_m": [2, 0, 0]}', "capture_time_s", "number"),
        ('{"age_s": 1' + 400 * "0" + ', "head_position_m": [2, 0, 0]}', "age_s", "number"),
        ('{"age_s": 0.1, "head_position_m": [NaN, 0, 0]}', "head_position_m", "finite"),
        ('{"age_s": 0.1, "head_position_m": [2, Infinity, 0]}', "head_position_m", "finite"),
        ('{"age_s": 0.1, "head_position_m": [1' + 400 * "0" + ", 0, 0]}", "head_position_m", ""),
        (GOOD | {"head_position_m": [1, 2]}, "head_position_m", "list of 3"),
        (GOOD | {"head_position_m": [[1, 2, 3]]}, "head_position_m", "list of 3"),
        (GOOD | {"head_position_m": []}, "head_position_m", "list of 3"),
        (GOOD | {"head_position_m": 2.0}, "head_position_m", "list of 3"),
        (GOOD | {"head_position_m": [1, [2], 3]}, "head_position_m", ""),
        (GOOD | {"head_position_m": {"x": 1, "y": 2, "z": 3}}, "head_position_m", ""),
        (GOOD | {"head_position_m": "ahead"}, "head_position_m", ""),
        (GOOD | {"head_position_m": ["a", 2, 3]}, "head_position_m", ""),
        (GOOD | {"head_position_m": [None, 2, 3]}, "head_position_m", ""),
        (GOOD | {"head_quat_wxyz": [1, 0, 0]}, "head_quat_wxyz", "list of 4"),
        (GOOD | {"head_quat_wxyz": [0, 0, 0, 0]}, "head_quat_wxyz", "unit length"),
        (GOOD | {"pelvis_quat_wxyz": [1, 1, 0, 0]}, "pelvis_quat_wxyz", "unit length"),
        (GOOD | {"pelvis_quat_wxyz": "upright"}, "pelvis_quat_wxyz", ""),
        (GOOD | {"pelvis_quat_wxyz": {"w": 1}}, "pelvis_quat_wxyz", ""),
        ('{"age_s": 0.1, "head_position_m": [2, 0, 0], "head_quat_wxyz": [NaN, 0, 0, 1]}', "head_quat_wxyz", "finite"),
    ],
)
def test_every_complaint_names_the_field_and_what_is_accepted(line, named, accepted):
    with pytest.raises(LineError) as raised:
        parse(line)
    message = str(raised.value)
    assert named in message
    assert accepted in message
    assert "base_m" not in message  # a name from inside
    assert len(message) < 1000


@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(), lambda inner: st.lists(inner)
       | st.dictionaries(st.sampled_from(FIELDS) | st.text(), inner), max_leaves=12))  # fmt: skip
def test_whatever_json_comes_it_is_an_observation_or_a_complaint(data):
    for line in (data, GOOD | {"head_position_m": data}, GOOD | {"head_quat_wxyz": data}, GOOD | {"age_s": data}):
        with contextlib.suppress(LineError):
            found = parse(json.dumps(line))
            assert np.all(np.isfinite(found.head_position_base_m))
            assert math.isfinite(found.capture_time_s)


@pytest.mark.parametrize(
    ("text", "expected"), [("5005", ("here", 5005)), ("a.b:1", ("a.b", 1)), ("::1:9", ("::1", 9)), (":7", ("here", 7))]
)
def test_addresses(text, expected):
    assert parse_address("udp:" + text, text, "here") == expected


@pytest.mark.parametrize("text", ["", "0", "65536", "http", "host:", "host:-1", "1.5", "host:²"])
def test_wrong_addresses_are_refused(text):
    with pytest.raises(SourceError, match="udp:PORT"):
        parse_address("udp:" + text, text, "here")


# --- sources


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


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


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


# --- the whole program


class Program:
    """`python -m gazempc.live` in a process of its own."""

    def __init__(self, *arguments):
        command = [sys.executable, "-m", "gazempc.live", "--no-figures", *map(str, arguments)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.said = b""

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.process.kill()
        for pipe in (self.process.stdin, self.process.stdout, self.process.stderr):
            pipe.close()
        self.process.wait()

    def until_it_runs(self):
        """It says so when it begins."""
        while b"Ctrl-C stops" not in self.said:
            ready, _, _ = select.select([self.process.stdout], [], [], FOREVER_S)
            chunk = self.process.stdout.read1() if ready else b""
            assert chunk, self.process.stderr.read().decode()
            self.said += chunk

    def walk(self, seconds, rate_hz=30):
        """Somebody walks by, in real time."""
        for k in range(int(seconds * rate_hz)):
            t = k / rate_hz
            head_m = [2.5, 1.2 * math.sin(1.2 * t), 0.4]
            observation = {"capture_time_s": time.time() - 0.03, "head_position_m": head_m, "head_quat_wxyz": QUAT}
            self.process.stdin.write(json.dumps(observation).encode() + b"\n")
            self.process.stdin.flush()
            time.sleep(1.0 / rate_hz)

    def end(self):
        out, err = self.process.communicate(timeout=FOREVER_S)
        return (self.said + out).decode(), err.decode()


def strict(path):
    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def check_output(out, said):
    summary = strict(out / "summary.json")
    assert summary["logs"] == ["log_000.npz"]
    log = load_log(out / "log_000.npz")
    assert log.time_s.size == summary["ticks"] > 10
    assert np.all(np.abs(log.command_velocity_rad_s[-1]) < 1e-9)
    assert np.all(np.isfinite(log.command_position_rad))
    neck = log.neck
    assert np.all(np.abs(log.command_velocity_rad_s) <= neck.velocity_max_rad_s * (1 + 1e-9))
    assert np.all(np.abs(log.command_acceleration_rad_s2) <= neck.acceleration_max_rad_s2 * (1 + 1e-9))
    jerk = np.diff(log.command_acceleration_rad_s2, axis=0) / neck.servo_period_s
    assert np.all(np.abs(jerk) <= neck.jerk_max_rad_s3 * (1 + 1e-6))
    assert summary["limit_violations"] == limit_violations(log, neck) == 0
    assert (out / "compute_000.npz").is_file()
    assert f"stopped by: {summary['stopped_by']}" in said
    return summary, log


@pytest.mark.parametrize("how", ["end of the source", "SIGINT", "SIGTERM", "SIGINT twice"])
def test_a_run_from_standard_input(how, tmp_path):
    """Fed for a while in real time, then ended: the neck at rest, everything written, exit status 0."""
    seconds = 2.0 if how == "end of the source" else 1.0
    with Program("--source", "stdin", "--robot", "simulated", "--out", tmp_path) as program:
        program.until_it_runs()
        program.walk(seconds)
        program.process.stdin.write(b"this is no observation\n")
        program.process.stdin.flush()
        if how == "end of the source":
            program.walk(0.2)
        else:
            for number in {"SIGINT": ["SIGINT"], "SIGTERM": ["SIGTERM"]}.get(how, ["SIGINT", "SIGTERM"]):
                program.process.send_signal(getattr(signal, number))
        said, complained = program.end()
        assert program.process.returncode == 0, complained
    assert "Traceback" not in complained
    summary, log = check_output(tmp_path, said)
    assert summary["stopped_by"] == ("end of the source" if how == "end of the source" else "signal")
    assert summary["observations"] >= 5
    if how == "end of the source":
        assert summary["observations"] == 66
        assert summary["bad_observations"] == 1
        assert "standard input, line 61: not JSON" in summary["problems"][0]
        assert "bad_observation" in summary["events"]
        # The figures of the log are those of the metrics; what nobody can know of a live run is left open.
        assert summary["metrics_of_last_log"]["gaze_error_rms_deg"] is None
        assert summary["metrics_of_last_log"]["rms_acceleration_rad_s2"] == pytest.approx(
            measure(log).rms_acceleration_rad_s2
        )
        assert summary["end_to_end_latency_ms"]["p50"] > 30.0
    assert np.ptp(log.command_position_rad[:, 0]) > 1e-3
    # Nobody told it where the head is but the lines: the forecast is of what they say.
    assert log.head_observed_base_m[:, 0] == pytest.approx(2.5)


def test_a_replay_in_real_time_and_on_a_simulated_clock_write_the_same_kind_of_log(tmp_path):
    """Also in process, on the simulated clock: metrics of the log, gaze error included."""
    arguments = ["--source", "replay", "--replay", "subject03_R4", "--simulated-clock", "--no-figures"]
    assert live.main([*arguments, "--out", str(tmp_path), "--log-s", "2"]) == 0
    summary = strict(tmp_path / "summary.json")
    assert summary["stopped_by"] == "end of the source"
    assert summary["logs"] == ["log_000.npz", "log_001.npz", "log_002.npz"]
    assert summary["skipped_ticks"] == summary["late_ticks"] == 0
    logs = [load_log(tmp_path / name) for name in summary["logs"]]
    times = np.concatenate([log.time_s for log in logs])
    assert np.diff(times) == pytest.approx(0.005, abs=1e-9)
    assert measure(logs[1]).gaze_error_rms_deg < 3.0
    assert summary["limit_violations"] == 0


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--source", "telepathy"], ["--source", "telepathy", "udp:PORT", "stdin"]),
        (["--source", "udp:99999"], ["udp:99999", "1 to 65535"]),
        (["--source", "tcp:nobody"], ["tcp:nobody", "tcp:HOST:PORT"]),
        (["--source", "udp:5005", "--simulated-clock"], ["--simulated-clock", "replay"]),
        (["--source", "replay", "--mount.on", "head"], ["--mount.on", "base"]),
        (["--source", "replay", "--neck", "no/such.toml"], ["no/such.toml"]),
        (["--source", "replay", "--neck", "refrence"], ["refrence", "reference"]),
        (["--source", "replay", "--replay", "subject99_R9"], ["subject99_R9"]),
        (["--source", "replay", "--sensor", "nosuch"], ["nosuch", "reference"]),
        (["--source", "replay", "--predictor", "perfect"], ["--predictor"]),
    ],
)
def test_bad_input_is_named_and_the_status_is_2(arguments, named, tmp_path, capsys):
    assert live.main([*arguments, "--out", str(tmp_path)]) == 2
    complained = capsys.readouterr().err
    for word in named:
        assert word in complained
    assert "Traceback" not in complained
    assert not list(tmp_path.iterdir())


def test_a_port_in_use_is_named_and_the_status_is_2(tmp_path, capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        assert live.main(["--source", f"udp:{port}", "--out", str(tmp_path), "--no-figures"]) == 2
    complained = capsys.readouterr().err
    assert f"UDP 127.0.0.1:{port}" in complained
    assert "in use" in complained
    assert live.main(["--source", f"tcp:{free_port()}", "--out", str(tmp_path), "--no-figures"]) == 2
    assert "TCP 127.0.0.1" in capsys.readouterr().err
    gc.collect()  # a socket that was left open complains here


def test_a_wrong_command_line_is_status_2(capsys):
    for arguments in ([], ["--source", "replay", "--robot", "toaster"], ["--source", "replay", "--log-s", "0"]):
        with pytest.raises(SystemExit) as raised:
            live.main(arguments)
        assert raised.value.code == 2
        capsys.readouterr()
    assert LiveSettings(source="stdin").robot == "simulated"
