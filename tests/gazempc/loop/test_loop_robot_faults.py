"""The loop when the robot does not answer: named, within limits, and the gaze back after it."""

import dataclasses

import numpy as np
import pytest
from builders.loop import NECK, TS, LoopBench, error_deg, events

from gazempc.controllers.mpc.mpc import Mpc
from gazempc.errors import RobotError


def unplugged(start_s, stop_s):
    """A robot that does not answer for a while, whatever it is asked."""

    def gone(now_s, state=None):
        if start_s <= now_s < stop_s:
            raise RobotError("no answer")
        return state

    return gone


def test_joints_that_cannot_be_read_for_two_seconds_are_known_from_the_commands():
    log = LoopBench(controller=Mpc(NECK, horizon_s=0.3), on_read=unplugged(1.5, 3.5)).run(5.0)
    assert "robot_not_answering" in events(log)
    assert "stale_plan" not in events(log)
    undisturbed = LoopBench(controller=Mpc(NECK, horizon_s=0.3)).run(5.0)
    assert log.command_position_rad == pytest.approx(undisturbed.command_position_rad, abs=1e-9)


def test_a_robot_that_does_not_answer_is_named_and_the_gaze_recovers():
    gone = unplugged(2.0, 2.6)
    log = LoopBench(on_read=gone, on_send=gone).run(6.0, answering=False)
    assert "robot_not_answering" in events(log)
    assert np.isnan(log.joint_position_rad).any()
    assert error_deg(log, from_s=4.5).mean() < 1.4  # 1.21 as measured


@pytest.mark.parametrize("silence_s", [0.05, 0.6])
def test_after_silence_the_robot_gets_no_jump(silence_s):
    """What the robot received, seen from the robot: every step within the limits, also over the silence."""
    gone = unplugged(2.0, 2.0 + silence_s)
    bench = LoopBench(on_read=gone, on_send=gone)
    log = bench.run(5.0, answering=False)
    after = [sent for t, sent in bench.robot.received if t >= 2.0]
    held = [sent for t, sent in bench.robot.received if t < 2.0][-1]
    padded = np.vstack([np.tile(held, (3, 1)), after])
    for order, limit in enumerate((NECK.velocity_max_rad_s, NECK.acceleration_max_rad_s2, NECK.jerk_max_rad_s3), 1):
        assert np.all(np.abs(np.diff(padded, order, axis=0)) / TS**order <= limit * (1 + 1e-6))
    silent = (log.time_s >= 2.0) & (log.time_s < 2.0 + silence_s - 1e-9)
    assert np.all(log.command_position_rad[silent] == held)


def test_after_a_single_lost_command_the_motion_goes_on_where_it_was():
    """The accepted commands, one after the other, are one motion within the limits, at speed."""
    lost = unplugged(2.0, 2.0 + 0.5 * TS)
    bench = LoopBench(on_send=lost, head_m=lambda t: np.array([2.5, 1.5 * t - 3.0, 0.4]))
    bench.run(3.0, answering=False)
    accepted = np.array([sent for t, sent in bench.robot.received if 1.5 <= t < 2.5])
    assert len(accepted) == round(1.0 / TS) - 1
    assert np.abs(np.diff(accepted[:, 0])).min() > 0.2 * TS
    assert np.all(np.abs(np.diff(accepted, 2, axis=0)) / TS**2 <= NECK.acceleration_max_rad_s2 * (1 + 1e-6))


def test_a_robot_that_raises_system_errors_or_answers_nonsense_is_a_robot_that_does_not_answer():
    def flaky(now_s):
        if 1.0 <= now_s < 1.1:
            raise TimeoutError("serial line")
        return (np.array([np.nan, 0.0]),) if 1.2 <= now_s < 1.3 else None

    log = LoopBench(on_send=flaky).run(4.0, answering=False)
    assert list(log.event_name).count("robot_not_answering") == 2
    assert np.all(np.isfinite(log.command_position_rad))


def test_joint_readings_that_are_nan_are_named_and_do_no_harm():
    def broken(now_s, state):
        return dataclasses.replace(state, position_rad=state.position_rad * (np.nan if now_s > 2.0 else 1.0))

    log = LoopBench(controller=Mpc(NECK, horizon_s=0.3), on_read=broken).run(4.0)
    assert "joint_reading_refused" in events(log)
    undisturbed = LoopBench(controller=Mpc(NECK, horizon_s=0.3)).run(4.0)
    assert log.command_position_rad == pytest.approx(undisturbed.command_position_rad, abs=1e-9)
