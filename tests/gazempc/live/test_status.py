"""Status lines of a live run: from the moments of a run with a hidden person."""

import contextlib
import io
import os
import threading
import time

import numpy as np
import pytest
from builders.live import NECK, run_live

from gazempc.live.status import StatusLine
from gazempc.loop.events import Event
from gazempc.results.moments import StatusMoment

HIDDEN_FROM_S, HIDDEN_TO_S = 1.5, 3.2


@pytest.fixture(scope="module")
def shown():
    """A run in which the person is hidden for a while; logs are cut meanwhile."""

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


def show(moments, file):
    with StatusLine(NECK, 1.0, file) as line:
        for moment in moments:
            line.take(moment)


def test_piped_it_is_one_line_a_second_and_each_event_is_explained_once(shown):
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


def test_a_pipe_without_a_reader_does_not_keep_a_run_from_ending(shown):
    read, write = os.pipe()
    os.set_blocking(write, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(write, bytes(4096))
    os.set_blocking(write, True)
    began_s = time.monotonic()
    with os.fdopen(write, "w") as full, StatusLine(NECK, 1.0, full, wait_s=0.1) as line:
        for moment in shown[0]:
            line.take(moment)
        line.__exit__(None, None, None)
        took_s = time.monotonic() - began_s
        # Read by now, so that the pipe can be closed.
        threading.Thread(target=os.read, args=(read, 1 << 20), daemon=True).start()
    assert took_s < 1.0
