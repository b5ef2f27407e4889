"""Start and end: no jump, braking within limits, all parts closed."""

import signal
import subprocess
import sys
import threading
from contextlib import nullcontext

import numpy as np
import pytest
from builders.checks import assert_sound, assert_within_limits
from builders.faults import answers_badly
from builders.live import NECK, WALK, Faulty, run_live
from builders.program import SIGNALLED
from builders.recordings import reordered
from builders.robots import Spied

from gazempc.errors import GazempcError, RobotError, SettingsError
from gazempc.files.documents import as_toml
from gazempc.live.run import LiveRun
from gazempc.live.session import parse
from gazempc.live.setup import build
from gazempc.live.sources.source import SourceError
from gazempc.loop.planner import ImmediatePlanner
from gazempc.neck.spec import load_neck
from gazempc.results.motion import limit_violations

START_RAD = np.array([0.5, -0.1])


@pytest.mark.parametrize(("kind", "until_s"), [(TimeoutError, 1.5), ("none", 0.3), ("nan", 1.5), ("three joints", 0.3)])
def test_unreadable_joints_delay_or_end_the_start_without_a_jump(kind, until_s):
    """A command straight ahead would be a jump; a robot that never answers may be refused."""

    def on_read(now_s, state):
        return answers_badly(kind, state) if now_s < until_s else state

    try:
        result = run_live(on_read=on_read, change=lambda now, s: [], start_rad=START_RAD, duration_s=0.5)
    except RobotError as error:
        result = error.result
        assert until_s > 1.0
        assert result.robot.calls == ["connect", "close"]
    # The first command equals the measured angles.
    assert all(np.allclose(position_rad, START_RAD, atol=1e-12) for _, position_rad in result.robot.received)


def test_a_stop_before_the_first_tick_causes_no_jump():
    stop = threading.Event()
    stop.set()
    result = run_live(stop=stop, start_rad=START_RAD)
    assert result.report.stopped_by == "signal"
    assert all(np.allclose(position, START_RAD) for _, position in result.robot.received)
    assert result.robot.calls[-1] == result.source.calls[-1] == "close"


REGION_DEG = (30.0, 60.0, -10.0, 20.0)


def test_a_start_outside_range_or_gaze_region_is_refused_but_a_simulated_robot_is_placed_inside():
    words = ["--source", "replay", "--simulated-clock", "--controller", "lookahead", "--predictor", "constant_velocity"]
    setup = build(parse([*words, "--robot", "simulated", "--loop.gaze-region-deg", *map(str, REGION_DEG)]))
    for neck, pan_deg, named in ((NECK, 120.0, r"pan 120\.0, tilt 0\.0 deg"), (setup.neck, 0.0, "gaze_region_deg")):
        with pytest.raises(RobotError, match=named) as raised:
            run_live(neck=neck, start_rad=np.radians([pan_deg, 0.0]))
        robot = raised.value.result.robot
        assert (robot.received, robot.calls) == ([], ["connect", "close"])
    logs = []
    LiveRun(setup, lambda log, _: logs.append(log)).run(threading.Event(), 1.0)
    pan_deg, tilt_deg = np.rad2deg(logs[0].command_position_rad).T
    assert pan_deg.min() >= REGION_DEG[0]
    assert tilt_deg.max() <= REGION_DEG[3]
    assert limit_violations(logs[0], setup.neck) == 0


@pytest.mark.parametrize(("region_deg", "accepted"), [(REGION_DEG, False), ((-20.0, 20.0, -10.0, 20.0), True)])
def test_without_encoders_a_region_must_contain_the_rest_pose(tmp_path, region_deg, accepted):
    """The first command is the rest pose; a rest pose outside the region would cause a step."""
    path = tmp_path / "blind.toml"
    path.write_text(as_toml(NECK.model_copy(update={"reports_joints": False}).model_dump(exclude_none=True)))
    words = ["--source", "replay", "--robot", "simulated", "--simulated-clock", "--neck", str(path)]
    settings = parse([*words, "--loop.gaze-region-deg", *map(str, region_deg)])
    with nullcontext() if accepted else pytest.raises(SettingsError, match="gaze_region_deg"):
        assert not build(settings).neck.reports_joints


@pytest.mark.parametrize("part", ["robot", "source"])
@pytest.mark.parametrize("error", [RobotError, RuntimeError])
def test_parts_that_fail_to_open_are_closed(part, error, monkeypatch):
    calls = []

    def fail(self):
        calls.append(self)
        raise error("cannot be opened")

    monkeypatch.setattr(Spied if part == "robot" else Faulty, "connect" if part == "robot" else "open", fail)
    # Undocumented exceptions of a user-defined part are converted to documented ones.
    promised = error if issubclass(error, GazempcError) else {"robot": RobotError, "source": SourceError}[part]
    with pytest.raises(promised, match="cannot be opened") as raised:
        run_live()
    result = raised.value.result
    assert result.robot.calls[-1] == result.source.calls[-1] == "close"
    assert not result.robot.received
    assert not result.logs


@pytest.mark.parametrize("why", ["signal", "duration", "end of the source"])
def test_a_stop_brakes_within_limits_and_closes_all_parts(why):
    stop, closed = threading.Event(), []

    def on_poll(now_s):
        if why == "signal" and now_s >= 1.5:
            stop.set()

    class Closing(ImmediatePlanner):
        def close(self):
            closed.append(True)

    walk = reordered(WALK, range(46)) if why == "end of the source" else WALK
    duration_s = 1.5 if why == "duration" else 5.0
    result = run_live(on_poll=on_poll, stop=stop, walk=walk, planner=Closing, duration_s=duration_s)
    assert_sound(result)
    assert result.report.stopped_by == why
    now, velocity = result.joined("time_s"), result.joined("command_velocity_rad_s")
    speed_before = np.abs(velocity[np.searchsorted(now, 1.45)]).max()
    assert speed_before > 0.1  # it was moving
    assert np.all(velocity[-1] == pytest.approx([0, 0], abs=1e-9))
    assert 1.5 < now[-1] < 2.0
    speed = np.abs(velocity[now > 1.6]).max(axis=1)
    assert np.all(np.diff(speed) <= 1e-9)  # braking all the way
    assert closed


@pytest.mark.parametrize("neck", [NECK, load_neck("ptz")], ids=["angles", "speeds"])
@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_a_run_ended_in_motion_brakes_the_neck_first(error, neck):
    """A log that cannot be written, and an interrupt, which takes the place of one command."""
    interrupted_s = []

    def on_send(now_s):
        if error is KeyboardInterrupt and now_s >= 1.5 and not interrupted_s:
            interrupted_s.append(now_s)
            raise error

    def keep(log, times):
        if error is OSError:
            raise error("no space left on device")

    with pytest.raises(error) as ended:
        run_live(neck=neck, on_send=on_send, keep=keep, log_s=1.5)
    result = ended.value.result
    times_s, received = map(np.array, zip(*result.robot.received, strict=True))
    assert 1.5 < times_s[-1] < 2.1
    if neck is NECK:
        gap = np.searchsorted(times_s, interrupted_s)
        assert_within_limits(received, ends=True, breaks=gap, rests=False)
    else:
        assert np.abs(received).max() > 0.1
        assert np.all(received[-1] == 0.0)
    assert result.robot.calls[-1] == result.source.calls[-1] == "close"


def test_the_first_signal_requests_the_end_and_the_third_ends_the_process():
    """The second arrives in the handler of the first: handlers run between any two instructions."""
    done = subprocess.run([sys.executable, "-c", SIGNALLED], capture_output=True, text=True, check=False, timeout=240)
    assert (done.stdout.split(), done.returncode) == (["True"], -signal.SIGHUP), done.stderr
