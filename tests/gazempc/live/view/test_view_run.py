"""A live run writes MCAP while it goes on, and serves the same channels."""

import asyncio
import json
import threading
import time

import numpy as np
import pytest
from builders.live import NECK
from builders.mcap import column, decoded, entities, numbers
from builders.ports import free_port
from builders.replays import run_info
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader

import gazempc as gz
from gazempc.errors import SettingsError
from gazempc.live.session import main, parse
from gazempc.live.view.orders import ViewOrders
from gazempc.live.view.viewers import Feed, ViewProcess
from gazempc.recordings.load import load
from gazempc.results.mcap import moments_of
from gazempc.results.metrics import gaze_error_deg
from gazempc.results.moments import CutMoment, EventMoment

QUICK = ["--source", "replay:subject03_R4", "--predictor", "constant_velocity", "--controller", "lookahead"]


def live(out, *more):
    assert main([*QUICK, "--no-figures", "--out", str(out), *more]) == 0
    return gz.load_log(out / "log_000.npz"), out / "log_000.mcap"


@pytest.fixture(scope="module", params=["reference_eyes", "reachy_mini_body"])
def simulated(request, tmp_path_factory):
    """A run on a simulated clock: nothing is lost, whatever else the computer does."""
    out = tmp_path_factory.mktemp("simulated")
    return live(out, "--simulated-clock", "--neck", request.param, "--log-s", "2.5")


@pytest.mark.slow
def test_each_log_has_its_file_and_all_its_numbers(simulated):
    log, path = simulated
    frame = log.to_pandas().ticks
    for name in frame:
        np.testing.assert_array_equal(column(path, "/ticks", name), frame[name], err_msg=name)
    observed = log.to_pandas().observations
    for name in ("capture_time_s", "arrival_time_s", "head_observed_y_base_m"):
        np.testing.assert_array_equal(column(path, "/observations", name), observed[name])
    forecasts = log.to_pandas().forecasts
    for name in ("horizon_s", "mean_x_base_m", "covariance_yz_m2"):
        np.testing.assert_array_equal(column(path, "/forecasts", name), forecasts[name])
    np.testing.assert_allclose(column(path, "/metrics", "gaze_error_deg"), gaze_error_deg(log), rtol=1e-12)
    assert [m.name for _, m in decoded(path, "/events")] == log.event_name.tolist()
    second, other = gz.load_log(path.with_name("log_001.npz")), path.with_name("log_001.mcap")
    np.testing.assert_array_equal(column(other, "/ticks", "time_s"), second.time_s)
    np.testing.assert_array_equal(gz.load_log(other).joint_position_rad, second.joint_position_rad)
    with path.open("rb") as file:
        about = {each.name: each.metadata for each in make_reader(file).iter_metadata()}
    assert about["gazempc_lost"] == {"moments": "0"}


def test_plans_are_what_is_commanded(simulated):
    """Commands follow the plan in use, as closely as the smoother's limits let them."""
    log, path = simulated
    plans = numbers(path, "/plan")
    assert len(plans) > 50
    for at, plan in plans[20:60]:
        k = int(np.searchsorted(log.time_s, at / 1e9 - 1e-6))
        knots_s = plan["start_s"] + plan["step_s"] * np.arange(len(plan["pan_rad"]))
        for j, name in enumerate(log.neck.joint_names):
            planned = np.interp(log.time_s[k], knots_s, plan[f"{name}_rad"])
            assert log.command_position_rad[k, j] == pytest.approx(planned, abs=0.02), name
    assert len(entities(path)["plan"]) == len(plans)
    assert np.nanmax(column(path, "/metrics", "latency_ms")) < 200.0


def received(url, topics, seconds=20.0):
    """The first message of each topic that a client of Foxglove's protocol gets, as JSON where it is that."""
    import websockets

    async def listen():
        found = {}
        async with websockets.connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
            names = {}
            while set(found) != set(topics):
                message = await asyncio.wait_for(socket.recv(), seconds)
                if isinstance(message, bytes):
                    number = int.from_bytes(message[1:5], "little")
                    found.setdefault(names[number], message[13:])
                    continue
                told = json.loads(message)
                if told["op"] == "advertise":
                    wanted = [c for c in told["channels"] if c["topic"] in topics]
                    names |= {c["id"]: c["topic"] for c in wanted}
                    subscriptions = [{"id": c["id"], "channelId": c["id"]} for c in wanted]
                    await socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
        return found

    return asyncio.run(listen())


@pytest.mark.slow
def test_a_run_on_the_real_clock_serves_foxglove_and_its_layout(tmp_path, capsys):
    port, found = free_port(), {}

    def look():
        until = time.monotonic() + 30.0
        while time.monotonic() < until and not found:
            try:
                found.update(received(f"ws://127.0.0.1:{port}", {"/ticks", "/metrics", "/scene", "/tf", "/plan"}))
            except OSError:
                time.sleep(0.05)

    looking = threading.Thread(target=look)
    looking.start()
    log, path = live(tmp_path, "--duration-s", "2.5", "--view", "--view-at", f"127.0.0.1:{port}")
    looking.join(240.0)
    said = capsys.readouterr().out
    assert f"view: open ws://127.0.0.1:{port} in Foxglove, with the layout {tmp_path}/foxglove_layout.json" in said
    assert "log_000.mcap, foxglove_layout.json" in said
    assert set(json.loads(found["/ticks"])) >= {"time_s", "joint_pan_rad", "command_tilt_rad"}
    metrics = json.loads(found["/metrics"])
    assert metrics["late_ms"] >= 0.0
    layout = (tmp_path / "foxglove_layout.json").read_text()
    for topic in ("/scene", "/metrics.gaze_error_deg", "/ticks.joint_pan_rad", "/events"):
        assert topic in layout
    # And what was served is in the file, with the lateness that only a live run knows.
    np.testing.assert_array_equal(column(path, "/ticks", "joint_pan_rad"), log.joint_position_rad[:, 0])
    assert np.isfinite(column(path, "/metrics", "late_ms")).all()


class Stuck:
    """A process for viewers that reads nothing."""

    def __init__(self):
        self.go_on, self.got = threading.Event(), []

    def send(self, batch):
        self.go_on.wait(240.0)
        self.got += batch

    def close(self):
        pass


def test_a_viewer_that_is_stuck_holds_nothing_up_and_the_newest_is_kept():
    stuck = Stuck()
    feed = Feed(stuck)
    started = time.perf_counter()
    feed.take(EventMoment(-1.0, "first", ""))
    time.sleep(0.1)  # this one is on its way
    for k in range(20_000):
        feed.take(CutMoment() if k == 3 else EventMoment(float(k), "event", ""))
    assert time.perf_counter() - started < 60.0
    assert feed.lost > 10_000
    stuck.go_on.set()
    feed.close()
    assert stuck.got[-1] == EventMoment(19_999.0, "event", "")
    assert [m for m in stuck.got if isinstance(m, CutMoment)] == [CutMoment()]
    assert len(stuck.got) + feed.lost == 20_001


def test_a_process_that_dies_is_said_and_the_run_goes_on(tmp_path):
    process = ViewProcess(ViewOrders(run_info(NECK), mcap_folder=tmp_path))
    process.start()
    feed = Feed(process)
    process._process.kill()
    process._process.join()
    for k in range(100):
        feed.take(EventMoment(float(k), "event", ""))
    feed.close()
    assert process.problem == "the process for viewers has gone"


def test_what_a_killed_run_leaves_can_be_read(simulated, tmp_path):
    """All but the last two seconds."""
    log, _ = simulated
    process = ViewProcess(ViewOrders(log.run, mcap_folder=tmp_path))
    process.start()
    process.send(list(moments_of(log)))
    path, until = tmp_path / "log_000.mcap", time.monotonic() + 20.0
    # Three flushes: at the first tick, two seconds later, and what is left of 2.5 s stays in memory.
    found = []
    while len(found) < 2.0 * log.neck.servo_rate_hz:
        assert time.monotonic() < until
        time.sleep(0.05)
        found = times_of_what_is_there(path)
    process._process.kill()
    process.close()
    assert times_of_what_is_there(path)[: len(found)] == found
    np.testing.assert_array_equal(found, log.time_s[: len(found)])


def times_of_what_is_there(path):
    found = []
    with path.open("rb") as file:
        reader = NonSeekingReader(file)
        try:
            for _, channel, message in reader.iter_messages(log_time_order=False):
                if channel.topic == "/ticks":
                    found.append(json.loads(message.data)["time_s"])
        except McapError:
            pass  # where it was cut off
    return found


def test_a_folder_that_cannot_be_written_is_said_before_the_run(tmp_path):
    (tmp_path / "log_000.mcap").mkdir()
    with pytest.raises(SettingsError, match=r"log_000\.mcap: cannot be written"):
        ViewProcess(ViewOrders(run_info(NECK), mcap_folder=tmp_path)).start()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--view", "--simulated-clock"], "--view: accepted without --simulated-clock"),
        (["--view-at", "nowhere:x"], "--view-at nowhere:x: accepted: HOST or HOST:PORT"),
        (["--passes", "2", "--source", "udp:5005"], "--passes: source 'udp:5005' does not use it"),
        (["--sensor", "perfect", "--source", "udp:5005"], "--sensor: source 'udp:5005' does not use it"),
        (["--distance-m", "9", "--source", "stdin"], "--distance-m: source 'stdin' does not use it"),
    ],
)
def test_what_does_not_go_together_is_refused(words, message):
    with pytest.raises(SettingsError, match=message):
        parse([*QUICK, *words])


def test_view_alone_is_foxglove_at_its_port():
    assert parse([*QUICK, "--view"]).view_address == ("127.0.0.1", 8765)
    assert parse([*QUICK, "--view", "web", "--view-at", "0.0.0.0"]).view_address == ("0.0.0.0", 8080)
    assert parse([*QUICK, "--view", "--no-figures"]).view == "foxglove"


def test_the_person_passes_again_after_two_seconds(tmp_path):
    log, _ = live(tmp_path, "--simulated-clock", "--passes", "2", "--log", "npz")
    walk = load("subject03_R4")
    known = np.isfinite(log.head_true_base_m[:, 0])
    (again_s,) = log.time_s[1:][known[1:] & ~known[:-1]]
    start_s = log.time_s[known][0]
    # Two more seconds are not scored, in which the neck turns back.
    assert again_s - start_s == pytest.approx(walk.times_s[-1] + 4.0, abs=0.01)
    # The same way as before: of the same times of the recording.
    own_s = log.time_s - np.where(log.time_s < again_s, start_s, again_s - 2.0)
    first, second = known & (log.time_s < again_s), known & (log.time_s >= again_s)
    for axis in range(3):
        expected = np.interp(own_s[second], own_s[first], log.head_true_base_m[first, axis])
        np.testing.assert_allclose(log.head_true_base_m[second, axis], expected, atol=0.02)
    assert "target_lost" in log.event_name
