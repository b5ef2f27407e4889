"""OP3, iKinGazeCtrl, humotion, PR2 and Smith compared with closed forms."""

import numpy as np
import pytest
from builders.rival_bench import CAMERA, NECK, Plant, camera, first_frame_only, neck_with, ramp, run, standing

from experiments.rivals.laws import RIVALS
from experiments.rivals.laws.robots import Humotion, IKinGazeCtrl, Op3, Pr2PointHead, limits_for
from experiments.rivals.laws.smith import Smith, SmithFeedForward

DIRECT = camera(latency_s=0.0, rate_hz=100.0)


def test_op3_moves_0_6_of_the_error_by_minimum_jerk():
    """18 of 30 deg, in 18 / 52.5 s from the frame's arrival."""
    course = run(Op3(NECK, CAMERA), standing(30.0), 1.0, seen=first_frame_only, dt_s=0.004)
    s = np.clip((course.time_s - 0.104) / (18.0 / 52.5), 0.0, 1.0)
    expected = 18.0 * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)
    # The law's step is 8 ms.
    np.testing.assert_allclose(np.rad2deg(course.command[:, 0]), expected, atol=0.9)
    assert np.rad2deg(course.command[-1, 0]) == pytest.approx(18.0)


def test_op3_oscillates_at_high_frame_rates_only():
    """It integrates 0.6 of the error per frame: a gain of 18 / s at 30 Hz."""
    fast = run(Op3(NECK, CAMERA), standing(20.0), 6.0, Plant(0.03, 0.09), dt_s=0.004)
    slow = run(Op3(NECK, CAMERA, detection_period_s=0.5), standing(20.0), 6.0, Plant(0.03, 0.09), dt_s=0.004)
    assert fast.head_deg[:, 0].max() > 40.0
    assert slow.head_deg[:, 0].max() < 21.0
    assert abs(slow.head_deg[-1, 0] - 20.0) < 1.0


def test_ikingazectrl_has_a_triple_pole():
    course = run(IKinGazeCtrl(NECK, DIRECT), standing(20.0), 3.0, seen=first_frame_only, camera=DIRECT)
    pt = 5.322 / 0.75 * course.time_s
    expected = 20.0 * (1.0 - np.exp(-pt) * (1.0 + pt + 0.5 * pt**2))
    np.testing.assert_allclose(course.head_deg[:, 0], expected, atol=0.35)
    assert np.interp(0.75, course.time_s, course.head_deg[:, 0]) == pytest.approx(18.0, abs=0.3)
    assert course.head_deg[:, 0].max() < 20.01


def test_ikingazectrl_lags_a_ramp_by_0_564_of_its_time():
    course = run(IKinGazeCtrl(NECK, DIRECT), ramp(20.0, -20.0), 4.0, camera=DIRECT)
    assert course.lag_s(20.0, 1.0) == pytest.approx(0.564 * 0.75, abs=0.01)


@pytest.mark.parametrize(("way_deg", "time_s"), [(5.0, 0.48), (40.0, 1.73)])
def test_humotion_limits_follow_from_its_motion_times(way_deg, time_s):
    """A time-optimal motion below its top speed takes 2 sqrt(distance / acceleration)."""
    speed, acceleration = np.rad2deg(limits_for(np.deg2rad([way_deg, way_deg])))
    assert speed[0] ** 2 / acceleration[0] > way_deg
    assert 2.0 * np.sqrt(way_deg / acceleration[0]) == pytest.approx(time_s, abs=0.006)


def test_humotion_clamps_to_its_range_and_holds_without_a_target():
    near = neck_with(position_min_deg=-50.0, position_max_deg=25.0)
    course = run(Humotion(near, CAMERA), standing(40.0), 4.0)
    assert course.head_deg[:, 0].max() == pytest.approx(20.0, abs=0.01)
    lost = run(Humotion(NECK, CAMERA), standing(40.0), 4.0, seen=lambda t: t < 0.03)
    assert np.ptp(lost.head_deg[lost.time_s > 1.15, 0]) == 0.0


def test_a_pr2_goal_is_a_cubic_of_its_duration():
    """40 deg at 1 rad/s take 0.70 s, from 0.01 s after the goal's arrival at 0.1 s."""
    course = run(Pr2PointHead(NECK, CAMERA), standing(40.0), 1.5, seen=first_frame_only)
    s = np.clip((course.time_s - 0.11) / np.deg2rad(40.0), 0.0, 1.0)
    held = (course.time_s * 1000).round().astype(int) // 10 * 10
    s = s[held]
    np.testing.assert_allclose(course.command[:, 0], np.deg2rad(40.0) * (3.0 * s**2 - 2.0 * s**3), atol=1e-6)


LAG_S, DEAD_S = 0.15, 0.2
# With this damping the servo is a first-order lag, as is the plant.
FIRST_ORDER = {"natural_frequency_rad_s": 20.0 / LAG_S, "damping_ratio": 10.0, "velocity_max_rad_s": 60.0}
MODEL = neck_with(**FIRST_ORDER, dead_time_s=DEAD_S)
STEADY = camera(rate_hz=50.0, latency_s=0.1)


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_smith_with_the_true_model_does_not_overshoot(gain):
    course = run(Smith(MODEL, STEADY, gain=gain), standing(30.0), 4.0, Plant(DEAD_S, LAG_S), STEADY)
    assert course.head_deg[:, 0].max() < 30.0 + 0.15
    assert course.head_deg[-1, 0] == pytest.approx(30.0, abs=0.01)
    # Gain K closes the loop around the model: the response is a lag of tau / K after all delays.
    since_s = np.maximum(course.time_s - (0.1 + DEAD_S), 0.0)
    expected = 30.0 * (1.0 - np.exp(-since_s * gain / LAG_S))
    np.testing.assert_allclose(course.head_deg[:, 0], expected, atol=0.02 if gain == 1.0 else 0.6)


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_smith_lags_a_ramp_by_all_delays_plus_lag_over_gain(gain):
    """A frame is 0.1 s old on arrival; a command is held for a step, which adds half a step over the gain."""
    course = run(Smith(MODEL, STEADY, gain=gain), ramp(10.0, -20.0), 6.0, Plant(DEAD_S, LAG_S), STEADY)
    assert course.lag_s(10.0, 1.0) == pytest.approx(0.1 + DEAD_S + (LAG_S + 0.01) / gain, abs=2e-3)


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_with_feedforward_smith_lags_by_half_a_step_over_the_gain(gain):
    course = run(SmithFeedForward(MODEL, STEADY, gain=gain), ramp(10.0, -20.0), 6.0, Plant(DEAD_S, LAG_S), STEADY)
    assert course.lag_s(10.0, 1.0) == pytest.approx(0.01 / gain, abs=2e-3)


@pytest.mark.parametrize("name", RIVALS)
def test_each_law_turns_to_the_face_and_start_resets_its_state(name):
    law = RIVALS[name](NECK, CAMERA)
    assert (law.name, law.command in ("position", "velocity")) == (name, True)
    first = run(law, standing(25.0, 10.0), 1.0, Plant(0.03, 0.09), dt_s=0.004)
    again = run(law, standing(25.0, 10.0), 1.0, Plant(0.03, 0.09), dt_s=0.004)
    np.testing.assert_array_equal(first.command, again.command)
    assert (first.head_deg[-1] != 0.0).all()
    assert (first.head_deg.max(axis=0) > [5.0, 2.0]).all()
