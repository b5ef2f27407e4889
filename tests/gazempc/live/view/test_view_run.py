"""A live run writes MCAP continuously, and serves the same channels."""

import json
import os
import signal
import threading
import time
from contextlib import closing, suppress

import numpy as np
import pytest
from builders.foxglove import received
from builders.live import NECK
from builders.mcap import column, decoded, times_of_what_is_there
from builders.ports import free_port
from builders.replays import cut, quick_neck, run_info
from builders.waiting import wait_for

import gazempc as gz
from gazempc.errors import SettingsError
from gazempc.live.session import main, parse
from gazempc.live.view.serving import ViewOrders
from gazempc.live.view.viewers import Feed
from gazempc.recordings.load import load
from gazempc.results.metrics import gaze_error_deg
from gazempc.results.moments import CutMoment, EventMoment, moments_of

QUICK = ["--source", "replay:subject03_R4", "--predictor", "constant_velocity", "--controller", "lookahead"]


def live(out, *more):
    assert main([*QUICK, "--no-figures", "--out", str(out), *more]) == 0
    return gz.load_log(out / "log_000.npz"), out / "log_000.mcap"


@pytest.mark.slow
def test_a_run_on_the_real_clock_serves_foxglove_and_its_layout(tmp_path, capsys):
    port, found = free_port(), {}

    def look():
        while not found:
            with suppress(OSError):
                found.update(received(f"ws://127.0.0.1:{port}", {"/ticks", "/metrics", "/scene", "/tf", "/plan"}))

    looking = threading.Thread(target=look, daemon=True)
    looking.start()
    log, path = live(tmp_path, "--duration-s", "1.5", "--view", "--view-at", f"127.0.0.1:{port}")
    looking.join(240.0)
    output = capsys.readouterr().out
    assert f"ws://127.0.0.1:{port}" in output
    assert "log_000.mcap, foxglove_layout.json" in output
    assert set(json.loads(found["/ticks"])) >= {"time_s", "joint_pan_rad", "command_tilt_rad"}
    assert json.loads(found["/metrics"])["late_ms"] >= 0.0
    layout = (tmp_path / "foxglove_layout.json").read_text()
    assert all(topic in layout for topic in ("/scene", "/metrics.gaze_error_deg", "/ticks.joint_pan_rad", "/events"))
    # The served data are in the file, with the lateness, which only a live run has.
    np.testing.assert_array_equal(column(path, "/ticks", "joint_pan_rad"), log.joint_position_rad[:, 0])
    np.testing.assert_array_equal(gz.load_log(path).command_position_rad, log.command_position_rad)
    assert np.isfinite(column(path, "/metrics", "late_ms")).all()


@pytest.mark.slow
def test_a_hanging_viewer_delays_no_tick_and_gets_the_newest_data(tmp_path):
    with closing(Feed(ViewOrders(run_info(NECK), mcap_folder=tmp_path))) as feed:
        feed.take(EventMoment(0.0, "event", ""))
        time.sleep(0.4)  # sent by now
        os.kill(feed.process.pid, signal.SIGSTOP)
        for k in range(1, 16_000):
            feed.take(CutMoment() if k == 1 else EventMoment(float(k), "event", ""))
        assert feed.lost > 3_000
        os.kill(feed.process.pid, signal.SIGCONT)
    events = [decoded(tmp_path / f"log_00{k}.mcap", "/events") for k in range(2)]
    assert events[1][-1][0] == 15_999 * 10**9
    assert sum(map(len, events)) + feed.lost == 15_999
    assert "moments did not reach viewers" in feed.problems[0]


@pytest.mark.slow
def test_a_killed_writer_is_a_problem_and_loses_at_most_2_s(tmp_path):
    words = {"sensor": "reference", "controller": "lookahead", "predictor": "constant_velocity"}
    log = cut(gz.replay("subject03_R4", neck=NECK, **words), 0.0, 2.5)
    feed = Feed(ViewOrders(log.run, mcap_folder=tmp_path))
    for moment in moments_of(log):
        feed.take(moment)
    path, enough = tmp_path / "log_000.mcap", 2.0 * log.neck.servo_rate_hz
    # Flushes at the first tick and two seconds later; the rest of 2.5 s stays in memory.
    found = wait_for(lambda: path.exists() and len(there := times_of_what_is_there(path)) >= enough and there)
    feed.process.kill()
    feed.process.join()
    feed.take(EventMoment(9.0, "event", ""))
    feed.close()
    assert feed.problems == ["the process for viewers has ended"]
    assert times_of_what_is_there(path)[: len(found)] == found
    np.testing.assert_array_equal(found, log.time_s[: len(found)])


def test_an_unwritable_folder_is_refused_at_the_start(tmp_path):
    (tmp_path / "log_000.mcap").mkdir()
    with pytest.raises(SettingsError, match=r"log_000\.mcap: cannot be written"):
        Feed(ViewOrders(run_info(NECK), mcap_folder=tmp_path))


def test_view_without_a_value_serves_foxglove_at_its_default_port():
    assert parse([*QUICK, "--view", "--no-figures"]).view_address == ("127.0.0.1", 8765)
    assert parse([*QUICK, "--view", "web", "--view-at", "0.0.0.0"]).view_address == ("0.0.0.0", 8080)


@pytest.mark.slow
def test_the_jump_of_the_person_between_two_passes_is_not_scored(tmp_path):
    log, _ = live(tmp_path, "--simulated-clock", "--passes", "2", "--log", "npz", "--neck", quick_neck(tmp_path))
    known = np.isfinite(log.head_true_base_m[:, 0])
    (again_s,) = log.time_s[1:][known[1:] & ~known[:-1]]
    # Two seconds between the passes, and two more in which the neck turns back.
    assert again_s - log.time_s[known][0] == pytest.approx(load("subject03_R4").times_s[-1] + 4.0, abs=0.03)
    second = log.time_s >= again_s
    error_deg = gaze_error_deg(log)
    first_deg, second_deg = (np.sqrt(np.nanmean(error_deg[each] ** 2)) for each in (known & ~second, second))
    assert second_deg < first_deg + 1.0  # with the jump 28 deg
    assert "target_lost" in log.event_name
