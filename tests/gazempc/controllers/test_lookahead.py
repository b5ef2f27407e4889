"""Commands of reactive and look-ahead, by hand."""

import numpy as np
import pytest
from builders.control import NECK, at_rest, crossing, forecast, run, still

from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.reactive import Reactive
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import load_neck


def turning(times, rate_rad_s=0.4):
    """A person who walks round the neck at a constant pan rate."""
    pan = rate_rad_s * np.asarray(times) - 0.5
    return np.stack([2.5 * np.cos(pan), 2.5 * np.sin(pan), np.zeros_like(pan)], axis=-1)


def planned(controller, path, command_rad=0.0, start_s=0.0, newest_s=0.0):
    """The plan for a constant past command."""
    known = forecast(controller.forecast_times_s(start_s, newest_s), path)
    return controller.plan(at_rest(NECK, known, [command_rad, 0.0], start_s))


@pytest.mark.parametrize("name", ["reference", "reachy_mini"])
@pytest.mark.parametrize("smoothing_time_s", [0.0, 0.1])
def test_a_steady_turn_is_followed_without_lag_or_lead(name, smoothing_time_s):
    """For any low-pass and rates; a lag of 1 ms would be 0.023 deg."""
    neck = load_neck(name)
    start = look_at_rad(neck.geometry, turning(0.0))
    joints, _, _ = run(
        LookAhead(neck, smoothing_time_s), neck, turning, round(2.8 * neck.servo_rate_hz), start_rad=start
    )
    times_s = neck.servo_period_s * np.arange(len(joints))
    aims = np.array([look_at_rad(neck.geometry, head)[0] for head in turning(times_s)])
    late = times_s > 2.6
    assert np.degrees(joints[late, 0] - aims[late]) == pytest.approx(0.0, abs=0.01)


def test_the_low_pass_follows_a_small_jump_by_its_time_constant():
    """After tau the command has made 1 - 1/e of the step, from the present command."""
    plan = planned(LookAhead(NECK, 0.1), still(0.08))
    assert plan.at(0.1 - NECK.control_period_s).position_rad[0] == pytest.approx(0.08 * (1.0 - np.exp(-1.0)))


@pytest.mark.parametrize("name", ["slow", "reachy_mini"])
def test_acquisition_is_not_smoothed(name):
    """The command is that without a low-pass down to 5 deg of error, and its overshoot is no larger."""
    neck, angle_rad = load_neck(name), np.radians(40.0)
    ticks = round(2.5 * neck.servo_rate_hz)
    plain, meant, _ = run(LookAhead(neck, 0.0), neck, still(angle_rad), ticks)
    smooth, commands, _ = run(LookAhead(neck, 0.1), neck, still(angle_rad), ticks)
    aim_rad = look_at_rad(neck.geometry, still(angle_rad)(0.0)[0])[0]
    far = np.degrees(aim_rad - meant[:, 0]) > 5.0
    assert 10 < far.sum() < ticks - 10
    assert commands[far, 0] == pytest.approx(meant[far, 0], abs=1e-12)
    assert np.degrees(np.abs(commands[~far, 0] - meant[~far, 0]).max()) > 0.1
    assert smooth[:, 0].max() <= max(plain[:, 0].max(), aim_rad) + np.radians(0.1)
    assert smooth[-1, 0] == pytest.approx(aim_rad, abs=np.radians(0.1))


def test_near_the_target_the_low_pass_restarts_from_the_command():
    """By hand: at 20 deg error no smoothing; then at 4 deg the first knot is a share of these 4 deg."""
    controller = LookAhead(NECK, 0.1)
    aim_rad = np.radians(20.0)
    far = planned(controller, still(aim_rad))
    assert far.position_rad[:, 0] == pytest.approx(aim_rad)
    share = 1.0 - np.exp(-NECK.control_period_s / 0.1)
    near = planned(controller, still(aim_rad), np.radians(16.0))
    assert near.position_rad[0, 0] == pytest.approx(np.radians(16.0 + 4.0 * share))
    # From then on the low-pass continues from its own state.
    near = planned(controller, still(aim_rad), np.radians(17.0))
    assert near.position_rad[0, 0] == pytest.approx(np.radians(20.0 - 4.0 * (1.0 - share) ** 2))


def test_reactive_holds_the_latest_position_and_lookahead_compensates_all_delays():
    """By hand: target at -1.2 m/s, commanded for now + 0.4 s + 0.15 s + half of the 5 ms hold."""
    now = 0.5
    plan = planned(Reactive(NECK), crossing, start_s=now, newest_s=0.43)
    assert plan.at(now).position_rad[0] == pytest.approx(np.arctan2(1.5 - 1.2 * 0.43, 2.5))
    plan = planned(LookAhead(NECK, 0.0), crossing, start_s=now, newest_s=0.43)
    assert plan.at(now).position_rad[0] == pytest.approx(np.arctan2(1.5 - 1.2 * (0.5 + 0.5525), 2.5))
