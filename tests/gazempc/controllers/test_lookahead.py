"""Reactive and look-ahead: what they command, by hand."""

import numpy as np
import pytest
from builders.control import NECK, crossing, forecast, run

from gazempc.controllers.controller import CommandState, Situation
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.reactive import Reactive
from gazempc.neck.kinematics import look_at


def test_a_smoothed_look_ahead_trails_a_ramp_by_its_time_constant():
    """The low-pass delays a steady motion by its time constant (to half a control period) and starts where it is."""
    start = look_at(NECK.geometry, crossing(0.0)).angles_rad
    plain, _, _ = run(LookAhead(NECK), NECK, crossing, 360, start_rad=start)
    smooth, _, _ = run(LookAhead(NECK, smoothing_time_s=0.1), NECK, crossing, 360, start_rad=start)
    speed = np.gradient(plain[:, 0], NECK.servo_period_s)[250:]
    assert np.median((smooth - plain)[250:, 0] / -speed) == pytest.approx(0.1, abs=0.015)


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
    ahead = LookAhead(NECK)
    plan = ahead.plan(Situation(forecast=forecast(ahead.forecast_times_s(now, 0.43), crossing), **base))
    assert plan.at(now).position_rad[0] == pytest.approx(np.arctan2(1.5 - 1.2 * (0.5 + 0.55), 2.5))
