"""Reactive and look-ahead: what they command, by hand."""

import numpy as np
import pytest
from builders.control import NECK, crossing, forecast, run

from gazempc.controllers.controller import CommandState, Situation
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.reactive import Reactive
from gazempc.neck.kinematics import look_at


@pytest.mark.parametrize("smoothing_time_s", [0.05, 0.1, 0.2])
def test_the_low_pass_makes_up_for_its_own_delay(smoothing_time_s):
    """On a steady motion: to half a control period, by which it is ahead."""
    start = look_at(NECK.geometry, crossing(0.0)).angles_rad
    plain, _, _ = run(LookAhead(NECK, 0.0), NECK, crossing, 360, start_rad=start)
    smooth, _, _ = run(LookAhead(NECK, smoothing_time_s), NECK, crossing, 360, start_rad=start)
    speed = np.gradient(plain[:, 0], NECK.servo_period_s)[250:]
    ahead_s = np.median((smooth - plain)[250:, 0] / speed)
    assert ahead_s == pytest.approx(0.5 * NECK.control_period_s, abs=0.006)


def test_the_low_pass_follows_a_jump_by_its_time_constant():
    """After tau the command is 1 - 1/e of the way; it starts where the command stands."""
    controller = LookAhead(NECK, 0.1)

    def jumped(times):
        return np.tile([2.5 * np.cos(0.2), 2.5 * np.sin(0.2), 0.0], (np.asarray(times).size, 1))

    rest = CommandState(np.zeros(2), np.zeros(2), np.zeros(2))
    times = controller.forecast_times_s(0.0, 0.0)
    zeros = np.zeros(2)
    situation = Situation(0.0, forecast(times, jumped), rest, zeros, zeros, zeros, np.zeros((100, 2)), np.zeros((0, 2)))
    plan = controller.plan(situation)
    assert plan.at(0.1 - NECK.control_period_s).position_rad[0] == pytest.approx(0.2 * (1.0 - np.exp(-1.0)))


def test_reactive_holds_the_latest_position_and_lookahead_the_one_after_all_delays():
    """By hand: the target at -1.2 m/s, commanded for now + 0.4 s + 0.15 s."""
    now = 0.5
    base = {
        "start_s": now,
        "command": CommandState(np.zeros(2), np.zeros(2), np.zeros(2)),
        "joint_position_rad": np.zeros(2),
        "joint_velocity_rad_s": np.zeros(2),
        "joint_offset_rad": np.zeros(2),
        "sent_rad": np.zeros((100, 2)),
        "committed_rad": np.zeros((0, 2)),
    }
    reactive = Reactive(NECK)
    plan = reactive.plan(Situation(forecast=forecast(reactive.forecast_times_s(now, 0.43), crossing), **base))
    assert plan.at(now).position_rad[0] == pytest.approx(np.arctan2(1.5 - 1.2 * 0.43, 2.5))
    ahead = LookAhead(NECK, 0.0)
    plan = ahead.plan(Situation(forecast=forecast(ahead.forecast_times_s(now, 0.43), crossing), **base))
    assert plan.at(now).position_rad[0] == pytest.approx(np.arctan2(1.5 - 1.2 * (0.5 + 0.55), 2.5))
