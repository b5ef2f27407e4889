"""Whom the robot looks at, told to others: lines at each change, by UDP, ROS 2 and into a file."""

import dataclasses
import json
import socket
import threading

import numpy as np
import pytest
from builders.bags import face_rows, write_bag

from gazempc.errors import SettingsError
from gazempc.live import session
from gazempc.live.clock import SimulatedClock
from gazempc.live.outlet import AttentionOutlet, make_sink
from gazempc.live.run import LiveRun
from gazempc.live.setup import build
from gazempc.people.attention import AttentionState

ANNA = AttentionState(1, "anna", "policy", 2.0, 3.5)
AWAY = AttentionState(1, "anna", "policy", 2.0, 3.5, "thinking", 2.5, 4.0)


class Gathered:
    """A sink that keeps what it gets, or fails."""

    def __init__(self, fails=()):
        self.lines, self.fails, self.closed = [], list(fails), False

    def __enter__(self):
        return self.send

    def send(self, line):
        if self.fails and self.fails.pop(0):
            raise OSError("No space left on device")
        self.lines.append(json.loads(line))

    def __exit__(self, *error):
        self.closed = True


def test_a_line_at_each_change_and_one_at_the_end():
    sink = Gathered()
    with AttentionOutlet(sink, SimulatedClock()) as outlet:
        for time_s, state in ((2.0, ANNA), (2.1, ANNA), (2.5, AWAY), (4.0, ANNA)):
            assert outlet.report(time_s, state) == []
    assert sink.closed
    assert sink.lines[0] == {"time_s": 2.0, **dataclasses.asdict(ANNA)}
    assert [(each["time_s"], each["away_why"], each["why"]) for each in sink.lines] == [
        (2.0, None, "policy"),
        (2.5, "thinking", "policy"),
        (4.0, None, "policy"),
        (0.0, None, "ended"),
    ]
    assert (sink.lines[1]["away_since_s"], sink.lines[1]["away_until_s"]) == (2.5, 4.0)


def test_a_run_goes_on_where_a_line_cannot_be_written(tmp_path):
    """On a full disk, say: an event of the log with the reason; the next line is written."""
    times_s = np.arange(30) / 30.0
    bag = write_bag(tmp_path / "bag", face_rows("face_a", 1e9 + times_s, [2.0, 0.3, 0.3], "camera_link"))
    words = ["--source", f"bag:{bag}", "--simulated-clock", "--attend", "nearest"]
    setup = build(session.parse([*words, "--controller", "lookahead", "--predictor", "constant_velocity"]))
    sink, logs = Gathered(fails=[False, True]), []
    with AttentionOutlet(sink, setup.clock) as outlet:
        run = LiveRun(setup, lambda log, _: logs.append(log), attention=outlet.report)
        run.run(threading.Event())
    assert [each["why"] for each in sink.lines] == ["nobody", "ended"]
    assert run.logs.events["attention_not_sent"] == 1
    assert "No space left on device" in next(f.line for f in run.logs.faults if f.event == "attention_not_sent")
    assert logs[0].attended_person.tolist() == [1]


def test_datagrams_and_a_file_that_begins_anew(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(5.0)
        with make_sink(f"udp:localhost:{listener.getsockname()[1]}") as send:
            send('{"person": 1}')
            assert listener.recv(100) == b'{"person": 1}\n'
    path = tmp_path / "attention.jsonl"
    path.write_text("of an earlier run\n")
    with make_sink(str(path)) as send:
        send("one")
        assert path.read_text() == "one\n"


@pytest.mark.parametrize("word", ["udp:5005", "udp:host:0", "ros2:", "attention.json", "tcp:host:1"])
def test_what_is_no_place(word):
    with pytest.raises(SettingsError, match=r"udp:HOST:PORT, ros2:TOPIC.*\.jsonl"):
        make_sink(word)
