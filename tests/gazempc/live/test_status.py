"""What a live run shows while it runs: the statuses of a run with known trouble, and how they read."""

import contextlib
import dataclasses
import io
import os
import threading
import time

import numpy as np
import pytest
from builders.live import NECK, run_live
from rich.console import Console

from gazempc.live import status_line
from gazempc.live.status import Status
from gazempc.live.status_line import StatusLine, observations, person
from gazempc.loop.events import Event
from gazempc.neck.kinematics import gaze_ray

STATUS = Status(
    time_s=1.0,
    age_s=0.071,
    lost=False,
    distance_m=2.312,
    observations=30,
    used=27,
    joints_rad=(-0.2, 0.1),
    gaze_rad=(-0.2, 0.1),
    aim_rad=(-0.25, 0.12),
    plan_age_s=0.006,
    late_ms=0.12,
    left_out=0,
    events=(),
)
HIDDEN_FROM_S, HIDDEN_TO_S = 1.5, 3.2


@pytest.fixture(scope="module")
def shown():
    """A run in which the person is hidden for a while; logs are cut meanwhile."""

    def hidden(now_s, sighting):
        return [] if HIDDEN_FROM_S < now_s < HIDDEN_TO_S else [sighting]

    statuses = []
    return statuses, run_live(change=hidden, duration_s=4.0, log_s=0.7, show=statuses.append)


def test_statuses_come_four_times_a_second(shown):
    statuses, _ = shown
    assert np.diff([status.time_s for status in statuses[:-1]]) == pytest.approx(0.25, abs=0.021)


def test_a_person_is_seen_then_lost_then_seen_again(shown):
    statuses, _ = shown
    # While the neck is braked at the end nobody is looked for.
    for status in statuses[:-1]:
        hidden_s = status.time_s - HIDDEN_FROM_S
        if status.time_s < HIDDEN_FROM_S or status.time_s > HIDDEN_TO_S + 0.1:
            assert not status.lost
            assert status.age_s is None or status.age_s < 0.12
        elif status.time_s < HIDDEN_TO_S:
            assert status.age_s == pytest.approx(hidden_s + 0.09, abs=0.06)
            assert status.lost == (status.age_s > 1.0)
    assert {status.lost for status in statuses} == {True, False}
    assert statuses[0].age_s is None
    assert all(2.0 < status.distance_m < 6.0 for status in statuses[1:])


def test_counts_and_events_are_those_of_the_logs(shown):
    statuses, result = shown
    last = statuses[-1]
    assert last.observations == last.used
    assert last.used == result.used
    told = [(round(time_s, 6), name) for status in statuses for time_s, name in status.events]
    start_s = result.joined("time_s")[0]
    began = zip(result.joined("event_time_s"), result.joined("event_name").tolist(), strict=True)
    wanted = [(round(time_s - start_s, 6), name) for time_s, name in began]
    assert told == wanted
    assert {"no_observation_yet", "target_lost"} <= {name for _, name in told}


def test_gaze_and_aim_are_directions_of_joints_and_commands(shown):
    statuses, result = shown
    time_s = result.joined("time_s") - result.joined("time_s")[0]
    commands = result.joined("command_position_rad")
    for status in statuses[2:]:
        tick = int(np.argmin(np.abs(time_s - status.time_s)))
        assert status.aim_rad == pytest.approx(tuple(commands[tick]), abs=1e-6)
        assert status.gaze_rad == pytest.approx(status.joints_rad, abs=1e-9)
        _, direction = gaze_ray(NECK.geometry, status.joints_rad)
        assert np.arctan2(direction[1], direction[0]) == pytest.approx(status.gaze_rad[0])
    assert any(status.plan_age_s is None for status in statuses), "no plan while nobody is there"
    assert all(0.0 <= status.plan_age_s < 0.03 for status in statuses if status.age_s and status.age_s < 0.1)


def test_what_is_said_of_a_person_and_of_observations():
    assert person(STATUS) == "seen 0.07 s ago, 2.31 m away"
    assert person(dataclasses.replace(STATUS, age_s=3.0, lost=True)) == "lost, last seen 3.00 s ago, 2.31 m away"
    assert person(dataclasses.replace(STATUS, age_s=None, distance_m=None)) == "nobody seen yet"
    before = dataclasses.replace(STATUS, time_s=0.0, observations=0, used=0)
    assert observations(STATUS, before) == "30 observations/s, 90 % used"
    assert observations(STATUS, STATUS) == "no observations"


def drawn(names, statuses, **console):
    file = io.StringIO()
    with StatusLine(names, Console(file=file, **console)) as line:
        for status in statuses:
            line.show(status)
    return file.getvalue()


def at(time_s, *events, **changes):
    count = round(30 * time_s)
    known = {"time_s": time_s, "observations": count, "used": count, "events": tuple((time_s, e) for e in events)}
    return dataclasses.replace(STATUS, **(known | changes))


def test_piped_it_is_one_line_a_second_and_each_new_event_is_explained():
    quarters = [at(0.25 * k, *(["late_plan"] if k in {2, 3, 6} else []), late_ms=0.1 * (k % 4)) for k in range(9)]
    lines = drawn(("pan", "tilt"), quarters, width=40).splitlines()
    assert lines == [
        f"   0.5 s  late_plan: {Event.LATE_PLAN.meaning}",
        "   1.0 s  seen 0.07 s ago, 2.31 m away; 30 observations/s, 100 % used; looks at pan -11.5, tilt +5.7 deg; "
        "aims at -14.3, +6.9; plan 6 ms old; ticks at most 0.30 ms late; began: late_plan 2 x",
        "   2.0 s  seen 0.07 s ago, 2.31 m away; 30 observations/s, 100 % used; looks at pan -11.5, tilt +5.7 deg; "
        "aims at -14.3, +6.9; plan 6 ms old; ticks at most 0.30 ms late; began: late_plan 1 x",
    ]


def test_of_a_shared_gaze_each_joint_is_named():
    joints = {"joints_rad": (-0.2, 0.1, 0.05), "gaze_rad": (-0.15, 0.1)}
    said = drawn(("pan", "tilt", "body_yaw"), [at(0.0, **joints), at(1.0, **joints)])
    assert (
        "looks at pan -8.6, tilt +5.7 deg; aims at -14.3, +6.9; joints pan -11.5, tilt +5.7, body_yaw +2.9 deg" in said
    )


def test_on_a_terminal_all_lines_fit_80_columns_and_the_last_state_stays():
    names = ("pan", "tilt", "eye_pan", "eye_tilt", "body_yaw")
    wide = {"joints_rad": (-1.9, 0.5, -0.6, -0.4, -2.6), "gaze_rad": (-2.5, -0.5), "aim_rad": (-2.6, -0.5)}
    crowd = [str(event) for event in Event]
    statuses = [at(0.25 * k, *crowd, **wide, left_out=1000) for k in range(5)]
    statuses.append(at(1.25, "own_event", **wide, lost=True, age_s=12.0))
    said = drawn(names, statuses, width=80, force_terminal=True, color_system=None, legacy_windows=False)
    block = said.rsplit("\x1b[2K", 1)[1].replace("\x1b[?25h", "").rstrip("\n").splitlines()
    assert [line.split()[0] for line in block] == ["person", "gaze", "joints", "loop", "events"]
    assert max(map(len, block)) <= 80
    assert "lost, last seen 12.00 s ago" in block[0]
    assert "body_yaw -149.0" in block[2]
    # The latest event is not cut off.
    assert block[4].split()[1:4] == ["own_event", "1", "x,"]


def test_a_closed_pipe_does_not_end_a_run():
    class Closed(io.StringIO):
        def write(self, text):
            raise BrokenPipeError

    with StatusLine(("pan", "tilt"), Console(file=Closed())) as line:
        for k in range(9):
            line.show(at(float(k)))


def test_a_pipe_that_nobody_reads_does_not_keep_a_run_from_ending(monkeypatch):
    monkeypatch.setattr(status_line, "_LAST_DRAWN_S", 0.1)
    read, write = os.pipe()
    os.set_blocking(write, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(write, bytes(4096))
    os.set_blocking(write, True)
    began_s = time.monotonic()
    with os.fdopen(write, "w") as full, StatusLine(NECK.joint_names, Console(file=full)) as line:
        line.show(STATUS)
        line.__exit__(None, None, None)
        took_s = time.monotonic() - began_s
        # Read by now, so that the pipe can be closed.
        threading.Thread(target=os.read, args=(read, 1 << 20), daemon=True).start()
    assert took_s < 1.0
