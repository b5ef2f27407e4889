"""Outputs of a run: status lines, and the attended person by UDP, ROS 2 and file."""

import dataclasses
import io
import json
import socket
import threading
import time
from contextlib import nullcontext

import numpy as np
import pytest
from builders.live import NECK, run_live

from gazempc.errors import SettingsError
from gazempc.live import session
from gazempc.live.clock import SimulatedClock
from gazempc.live.outlet import AttentionOutlet, make_sink
from gazempc.live.run import LiveRun
from gazempc.live.setup import build
from gazempc.live.status import StatusLine
from gazempc.loop.events import Event
from gazempc.people.attention import AttentionState
from gazempc.results.moments import StatusMoment

HIDDEN_FROM_S, HIDDEN_TO_S = 1.5, 3.2


@pytest.fixture(scope="module")
def shown():
    """A run with the person hidden for a while; logs are split meanwhile."""

    def hidden(now_s, sighting):
        return [] if HIDDEN_FROM_S < now_s < HIDDEN_TO_S else [sighting]

    moments = []
    return moments, run_live(change=hidden, duration_s=4.0, log_s=0.7, listeners=[moments.append])


def test_listeners_get_a_status_four_times_a_second(shown):
    moments, result = shown
    statuses = [moment for moment in moments if isinstance(moment, StatusMoment)]
    assert np.diff([status.time_s for status in statuses[:-1]]) == pytest.approx(0.25, abs=0.021)
    assert (statuses[-1].observations, statuses[-1].used) == (result.used, result.used)
    commands, time_s = result.joined("command_position_rad"), result.joined("time_s")
    for status in statuses[2:]:
        np.testing.assert_allclose(status.command_rad, commands[np.argmin(np.abs(time_s - status.time_s))], atol=1e-6)
    assert any(status.plan_start_s is None for status in statuses), "no plan while the person is hidden"


def show(moments, file, wait_s=60.0):
    with StatusLine(NECK, 1.0, file, wait_s) as line:
        for moment in moments:
            line.take(moment)


def test_piped_status_is_one_line_a_second_with_each_event_explained_once(shown):
    moments, result = shown
    file = io.StringIO()
    show(moments, file)
    lines = file.getvalue().splitlines()
    statuses = [line for line in lines if "looks at" in line]
    assert [line.split("s  ")[1].split(" ")[0] for line in statuses] == ["seen", "seen", "lost,", "seen"]
    assert "observations/s, 100 % used" in statuses[0]
    assert "target_lost" in statuses[2]
    names = dict.fromkeys(result.joined("event_name").tolist())
    assert [line.split("  ")[-1] for line in lines if line not in statuses] == [
        f"{name}: {Event(name).meaning}" for name in names
    ]


def test_a_closed_pipe_does_not_end_a_run(shown):
    class Closed(io.StringIO):
        def write(self, text):
            raise BrokenPipeError

    show(shown[0], Closed())


def test_a_pipe_without_a_reader_does_not_block_the_end(shown):
    read = threading.Event()

    class Full(io.StringIO):
        def write(self, text):
            read.wait()

    began_s = time.monotonic()
    show(shown[0], Full(), wait_s=0.1)
    assert time.monotonic() - began_s < 1.0
    read.set()


ANNA = AttentionState(1, "anna", "policy", 2.0, 3.5)
AWAY = AttentionState(1, "anna", "policy", 2.0, 3.5, "thinking", 2.5, 4.0)


def test_the_attended_file_is_truncated_and_gets_a_line_at_each_change_and_the_end(tmp_path):
    path = tmp_path / "attention.jsonl"
    path.write_text("of an earlier run\n")
    with AttentionOutlet(make_sink(str(path)), SimulatedClock()) as outlet:
        for time_s, state in ((2.0, ANNA), (2.1, ANNA), (2.5, AWAY), (4.0, ANNA)):
            assert outlet.report(time_s, state) == []
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert lines[0] == {"time_s": 2.0, **dataclasses.asdict(ANNA)}
    assert [(each["time_s"], each["away_why"], each["why"]) for each in lines] == [
        (2.0, None, "policy"),
        (2.5, "thinking", "policy"),
        (4.0, None, "policy"),
        (0.0, None, "ended"),
    ]
    assert (lines[1]["away_since_s"], lines[1]["away_until_s"]) == (2.5, 4.0)


def test_a_failed_write_is_an_event_and_the_run_continues():
    """For example on a full disk: an event with the reason; the next line is written."""
    words = ["--source", "replay", "--simulated-clock", "--attend", "nearest", "--controller", "lookahead"]
    setup, lines, logs = build(session.parse([*words, "--predictor", "constant_velocity"])), [], []

    def send(line):
        lines.append(json.loads(line))
        if len(lines) == 2:
            raise OSError("No space left on device")

    with AttentionOutlet(nullcontext(send), setup.clock) as outlet:
        run = LiveRun(setup, lambda log, _: logs.append(log), attention=outlet.report)
        run.run(threading.Event(), 1.0)
    assert [each["why"] for each in lines[::2]] == ["no_person", "ended"]
    assert run.logs.events["attention_not_sent"] == 1
    assert "No space left on device" in next(f.line for f in run.logs.faults if f.event == "attention_not_sent")
    assert logs[0].attended_person.tolist() == [1]


def test_attended_people_are_sent_as_datagrams():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(5.0)
        with make_sink(f"udp:localhost:{listener.getsockname()[1]}") as send:
            send('{"person": 1}')
            assert listener.recv(100) == b'{"person": 1}\n'


@pytest.mark.parametrize("word", ["udp:5005", "udp:host:0", "ros2:", "attention.json", "tcp:host:1"])
def test_an_invalid_destination_is_refused(word):
    with pytest.raises(SettingsError, match=r"udp:HOST:PORT, ros2:TOPIC.*\.jsonl"):
        make_sink(word)
