"""Gaze: a tracker's program drives a neck; at any end of the block the neck is braked and the robot closed."""

import math
import threading
import time
import warnings

import numpy as np
import pytest
from builders.gazes import Robot, assert_braked_and_closed, moves, see_for
from builders.live import NECK
from builders.waiting import FOREVER_S, wait_for

import gazempc as gz
from gazempc.errors import RobotError, SettingsError
from gazempc.loop.gaze_loop import GazeLoop
from gazempc.results.moments import TickMoment
from gazempc.results.motion import limit_violations
from gazempc.settings import LoopSettings


def gaze(robot, **settings):
    return gz.Gaze(NECK, robot, predictor="constant_velocity", **settings)


def test_the_gaze_follows_and_the_neck_is_braked_however_the_block_ends():
    robot, logs = Robot(), []

    def block():
        with gaze(robot, clock="monotonic") as opened:
            wait_for(lambda: len(robot.received) > 20)
            logs.append(opened.log())
            wait_for(lambda: np.ptp(robot.sent, axis=0).max() > 0.2, step=lambda: see_for(opened, 0.2, time.monotonic))
            wait_for(lambda: moves(robot), step=lambda: see_for(opened, 0.2, time.monotonic))
            logs.append(opened)
            raise SystemExit("the tracker's")

    with pytest.raises(SystemExit, match="the tracker's"):
        block()
    sent = assert_braked_and_closed(robot)
    assert robot.threads == {"servo"}
    so_far, opened = logs
    log = opened.log()
    np.testing.assert_array_equal(log.command_position_rad, sent)
    assert np.all(np.diff(log.time_s) > 0)
    assert log.time_s[0] == so_far.time_s[0]
    assert log.time_s.size > so_far.time_s.size > 10
    # The stamps became the loop's time: an observation is 30 ms old when it arrives, on a busy computer older.
    assert np.min(log.arrival_time_s - log.capture_time_s) == pytest.approx(0.03, abs=0.01)
    assert log.head_observed_base_m[:, 0] == pytest.approx(2.0)
    assert (log.run.robot, log.run.predictor, log.run.mode) == ("spied", "constant_velocity", "live")
    assert 0.0 < opened.joints.position_rad[0] < math.radians(60.0)
    assert opened.faults == ()
    assert limit_violations(log, NECK) == 0


def test_a_setting_of_the_loop_keeps_the_defaults_of_a_live_loop():
    usual = gaze(Robot()).settings.loop
    for loop in ({"lost_after_s": 2.0}, LoopSettings(lost_after_s=2.0)):
        assert gaze(Robot(), loop=loop).settings.loop == usual.model_copy(update={"lost_after_s": 2.0})
    assert usual.compute_delay_s > 0.0


def test_a_raising_listener_is_an_event_and_the_run_continues():
    ticks, robot = [], Robot()

    def viewer(moment):
        ticks.extend([moment] if isinstance(moment, TickMoment) else [])
        if len(ticks) == 30:
            raise SystemExit("no picture")

    with gaze(robot, listener=viewer) as opened:
        wait_for(lambda: opened.faults and len(robot.received) > 60)
        (fault,) = opened.faults
    assert (fault.event, fault.count, len(ticks)) == ("listener_failed", 1, 30)
    assert "SystemExit: no picture" in fault.error
    assert "viewer" in fault.traceback
    assert opened.log().faults == (fault,)
    assert_braked_and_closed(robot)


class BugError(Exception):
    """A program error outside of any part."""


def test_a_servo_thread_exception_is_raised_after_braking_by_see_and_at_exit(monkeypatch):
    seen = []

    def note_heads(self, sightings, time_s):
        seen.extend(sightings)
        if len(seen) > 20:
            raise BugError("in the servo thread")

    monkeypatch.setattr(GazeLoop, "note_heads", note_heads)
    robot = Robot()
    at_the_end, by_see = (pytest.raises(BugError, match="in the servo thread") for _ in range(2))
    with at_the_end, gz.Gaze(NECK, robot) as opened, by_see:
        see_for(opened, FOREVER_S)
    assert_braked_and_closed(robot)


def test_a_failed_connection_closes_the_robot_and_starts_no_thread():
    class Away(Robot):
        def connect(self):
            super().connect()
            raise RobotError("switched off")

    robot, before = Away(), threading.active_count()
    with pytest.raises(RobotError, match="switched off"), gaze(robot):
        pytest.fail("there is no robot")
    assert (robot.calls, robot.received, threading.active_count()) == (["connect", "close"], [], before)


def test_the_neck_is_braked_when_the_observing_thread_ends_inside_the_block():
    robot = Robot()
    opened = gaze(robot)
    tracker = threading.Thread(target=lambda: see_for(opened.__enter__(), 0.5))
    tracker.start()
    tracker.join(FOREVER_S)
    opened._thread.join(FOREVER_S)
    assert not opened._thread.is_alive()
    assert_braked_and_closed(robot)
    opened.__exit__(None, None, None)


@pytest.mark.slow
def test_only_the_last_minutes_of_a_long_run_are_kept():
    with gaze(Robot(), keep_minutes=0.005) as opened:
        wait_for(lambda: "no_observation_yet" in opened.events)
        cuts_s = [time.monotonic()]
        for _ in range(6):
            see_for(opened, 0.15)
            opened.log()
            cuts_s.append(time.monotonic())
    kept_s = np.ptp(opened.log().time_s)
    # The oldest log exceeds the limit by less than its own length.
    assert 0.29 <= kept_s < 0.6 + np.diff(cuts_s).max()
    assert opened.events["no_observation_yet"] >= 1  # of the whole run


@pytest.mark.parametrize(
    ("clock", "time_s", "named"),
    [("unix", lambda: 1e3 * time.time(), "time.time"), ("monotonic", time.time, 'clock="unix"')],
)
def test_an_invalid_time_is_refused_at_the_call(clock, time_s, named, monkeypatch):
    monkeypatch.setattr(time, "monotonic", lambda real=time.monotonic: real() + 1e6)
    with gaze(Robot(), clock=clock) as opened, pytest.raises(ValueError, match=f"time_s.*{named}"):
        opened.see(time_s(), [2.0, 0.0, 0.0])
    assert opened.log().capture_time_s.size == 0


def test_stated_values_reach_predictor_and_log_and_invalid_ones_are_refused():
    taken = []

    class Keeps(gz.ConstantVelocity):
        def update(self, observation):
            taken.append(observation)
            super().update(observation)

    covariance = gz.bearing_covariance([2.0, 0.1, 0.3], 0.002, 1.0)
    stated = {"head_yaw_sd_rad": 0.1, "pelvis_yaw_sd_rad": 0.2, "confidence": 0.7}
    quats = {"head_quat_wxyz": [1, 0, 0, 0], "pelvis_quat_wxyz": [0, 0, 0, 1]}
    with gz.Gaze(NECK, Robot(), predictor=Keeps()) as opened:
        taken.clear()  # observations of the warm-up
        opened.see(time.time(), [2.0, 0.1, 0.3], covariance_m2=covariance, person_id=7, **quats, **stated)
        wait_for(lambda: len(taken) == 1)
        for name, wrong in (("head_m", [1.0, 2.0]), ("head_quat_wxyz", [1, 1, 0, 0]), ("time_s", "now")):
            with pytest.raises(ValueError, match=name):
                opened.see(**{"time_s": time.time(), "head_m": [2.0, 0.0, 0.3], name: wrong})
        with pytest.raises(ValueError, match="sensor itself"):
            opened.see(time.time(), [0.0, 0.0, 0.0])
        with pytest.raises(TypeError, match=r"'covariance'.*head_quat_wxyz.*confidence"):
            opened.see(time.time(), [2.0, 0.1, 0.3], covariance=covariance)
        opened.see(time.time(), [2.0, 0.1, 0.3], person_id=None)
        wait_for(lambda: len(taken) == 2)
    first, second = taken
    np.testing.assert_allclose(first.position_covariance_m2, covariance)
    assert {name: getattr(first, name) for name in stated} == stated
    np.testing.assert_allclose(first.pelvis_quat_wxyz, [0, 0, 0, 1])
    assert second.position_covariance_m2 is None
    assert opened.log().person_id.tolist() == ["7", ""]


@pytest.mark.slow
def test_findings_warn_at_the_next_see_and_used_observations_are_counted():
    robot = Robot()
    with warnings.catch_warnings(record=True) as caught, gaze(robot) as opened:
        warnings.simplefilter("always")
        for _ in range(36):
            opened.see(time.time() - 0.03, [2000.0, 100.0, 300.0])
            time.sleep(1 / 30)
    assert 'mount={"unit_m": 0.001}' in str(caught[-1].message)
    assert [text.partition(":")[0] for text in opened.warnings] == ["implausible_person", "wrong_unit"]
    assert opened.observations["used"] == 0
    assert opened.observations["implausible_person"] > 30
    assert opened.events["wrong_unit"] == 1


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"robot": "simulatd"}, "simulated"),
        ({"robot": Robot}, "is a class"),
        ({"options": {"prot": 1}}, "options.prot"),
    ],
)
def test_invalid_arguments_are_reported_before_any_motion(arguments, named):
    with pytest.raises(SettingsError, match=named):
        gz.Gaze(**{"neck": NECK, "robot": "simulated", **arguments})


def test_a_gaze_works_once_and_only_inside_its_block():
    opened = gaze(Robot())
    with pytest.raises(RuntimeError, match="before"):
        opened.see(time.time(), [2.0, 0.0, 0.0])
    with opened:
        opened.see(time.time(), [2.0, 0.0, 0.0])
    with pytest.raises(RuntimeError, match="after"):
        opened.see(time.time(), [2.0, 0.0, 0.0])
    with pytest.raises(RuntimeError):
        opened.__enter__()


LEFT_M, RIGHT_M = [2.0, 0.8, 0.3], [2.5, -1.0, 0.3]


@pytest.mark.slow
def test_the_speaker_is_attended_and_thinking_averts_the_gaze():
    thinking, robot = [], Robot()
    settings = {"hysteresis_s": 0.2, "dwell_s": 0.2}
    with gaze(robot, attend="speaker", attention=settings) as opened:
        start_s = time.monotonic()
        while (elapsed_s := time.monotonic() - start_s) < 1.8:
            now_s = time.time() - 0.03
            opened.see(now_s, LEFT_M, person_id="anna")
            opened.see(now_s, RIGHT_M, person_id="bob")
            if elapsed_s > 0.4:
                opened.hear(math.atan2(RIGHT_M[1], RIGHT_M[0]))
            if elapsed_s > 1.1 and not thinking:
                thinking.append(opened.think(0.6))
            time.sleep(1 / 30)
        assert opened.attended.number == 2
        assert opened.warnings == ()
    assert_braked_and_closed(robot)
    log = opened.log()
    assert log.attended_person.tolist() == [1, 2]
    assert log.away_why.tolist() == ["thinking"]
    assert log.away_end_s[0] - log.away_start_s[0] == pytest.approx(0.6)
