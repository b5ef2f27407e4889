"""Status lines of a live run: from the moments of a run with a hidden person, and of statuses made by hand."""

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
from gazempc.results.moments import EventMoment, LateMoment, StatusMoment, TickMoment

HIDDEN_FROM_S, HIDDEN_TO_S = 1.5, 3.2
LINE = (
    "seen 0.07 s ago, 2.31 m away; 30 observations/s, 90 % used; looks at pan -11.5, tilt +5.7 deg; "
    "aims at -14.3, +6.9; plan 6 ms old; ticks at most {} ms late; began: late_plan {} x"
)


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


def test_the_lines_of_a_run_follow_the_person(shown):
    moments, result = shown
    lines = printed(moments).splitlines()
    states = [line.split("s  ")[1].split(" ")[0] for line in lines if "looks at" in line]
    assert states == ["seen", "seen", "lost,", "seen"]
    named = [line.split("  ")[-1].split(":")[0] for line in lines if "looks at" not in line]
    assert named == list(dict.fromkeys(result.joined("event_name").tolist()))


def printed(moments):
    file = io.StringIO()
    with StatusLine(NECK, 1.0, file) as line:
        for moment in moments:
            line.take(moment)
    return file.getvalue()


def at(time_s, *events, late_ms=0.12, skipped=0, joints_rad=(-0.2, 0.1), command_rad=(-0.25, 0.12), age_s=0.071):
    """The moments up to a status, with the observations of 30 frames a second of which 27 were used."""
    head_m = 2.312 * np.array([1.0, 0.0, 0.0])
    counts = round(30 * time_s), round(27 * time_s)
    status = StatusMoment(
        time_s, np.array(joints_rad), np.array(command_rad), time_s - age_s, head_m, time_s - 0.006, *counts
    )
    tick = TickMoment(time_s, None, np.array(command_rad), ())
    return [LateMoment(late_ms, skipped), tick, *(EventMoment(time_s, name, "") for name in events), status]


def test_piped_it_is_one_line_a_second_and_each_new_event_is_explained():
    moments = []
    for k in range(9):
        moments += at(0.25 * k, *(["late_plan"] if k in {2, 3, 6} else []), late_ms=0.1 * (k % 4))
    assert printed(moments).splitlines() == [
        f"   0.5 s  late_plan: {Event.LATE_PLAN.meaning}",
        "   1.0 s  " + LINE.format("0.30", 2),
        "   2.0 s  " + LINE.format("0.30", 1),
    ]


def test_a_closed_pipe_does_not_end_a_run():
    class Closed(io.StringIO):
        def write(self, text):
            raise BrokenPipeError

    with StatusLine(NECK, 1.0, Closed()) as line:
        for moment in [moment for k in range(9) for moment in at(float(k))]:
            line.take(moment)


def test_a_pipe_without_a_reader_does_not_keep_a_run_from_ending():
    read, write = os.pipe()
    os.set_blocking(write, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(write, bytes(4096))
    os.set_blocking(write, True)
    began_s = time.monotonic()
    with os.fdopen(write, "w") as full, StatusLine(NECK, 1.0, full, wait_s=0.1) as line:
        for moment in [*at(0.0), *at(1.0)]:
            line.take(moment)
        line.__exit__(None, None, None)
        took_s = time.monotonic() - began_s
        # Read by now, so that the pipe can be closed.
        threading.Thread(target=os.read, args=(read, 1 << 20), daemon=True).start()
    assert took_s < 1.0
