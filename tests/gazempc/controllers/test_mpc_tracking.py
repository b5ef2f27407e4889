"""The MPC on walking people and lateral steps: dead times, limits, acquisition without overshoot."""

import numpy as np
import pytest
from builders.control import NECK, at_rest, crossing, forecast, run, still
from scipy.optimize import linprog

from gazempc.controllers.mpc.acquisition import Acquisition
from gazempc.controllers.mpc.condense import AxisModel
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.errors import SettingsError
from gazempc.loop.smoother import Smoother
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import load_neck


def earliest_arrival_s(distance_rad, tolerance_rad, steps=60):
    """By linear programming: the earliest step from which the joint can stay in the tolerance, within limits."""
    p = AxisModel(NECK, 0, (1,) * steps, steps)
    limits = NECK.command_limits
    each = limits.position_max_rad[0], limits.velocity_max_rad_s[0], limits.acceleration_max_rad_s2[0]
    bounds, command = np.repeat(each, steps), p.knots[:, 6:]
    jerk = limits.jerk_max_rad_s3[0] / p.jerk_scale
    for first in range(steps):
        arrived = p.joint[first:, 6:]
        ends = np.repeat([distance_rad + tolerance_rad, tolerance_rad - distance_rad], len(arrived))
        A, b = np.vstack([command, -command, arrived, -arrived]), np.concatenate([bounds, bounds, ends])
        if linprog(np.zeros(steps), A_ub=A, b_ub=b, bounds=(-jerk, jerk)).success:
            return NECK.pan.dead_time_s + (first + 1) * NECK.control_period_s
    raise AssertionError("never")


def test_with_the_true_future_the_gaze_tracks_the_person():
    _, _, errors = run(Mpc(NECK), NECK, crossing, 400, start_rad=look_at_rad(NECK.geometry, crossing(0.0)))
    assert errors[300:].max() < 0.028  # 0.024 as measured


@pytest.mark.parametrize("dead_times", [(0.2513, 0.4), (0.0, 0.003)])
def test_fractional_and_unequal_dead_times_add_no_error(dead_times):
    """Dead times of pan and tilt that are unequal and no multiple of a tick: the error is that of whole ones."""
    axes = {
        name: getattr(NECK, name).model_copy(update={"dead_time_s": dead})
        for name, dead in zip(("pan", "tilt"), dead_times, strict=True)
    }
    neck = NECK.model_copy(update=axes)
    neck.__dict__.pop("dead_time_s", None)

    def path(times):
        position = crossing(times)
        position[..., 2] += 0.3 * np.sin(2.0 * np.asarray(times))
        return position

    start = look_at_rad(neck.geometry, path(0.0))
    _, _, errors = run(Mpc(neck), neck, path, 400, start_rad=start)
    assert errors[300:].max() < 0.035  # at most 0.030 as measured


def test_a_step_is_time_optimal():
    """The arrival time is that of the linear program, dead time included, without overshoot at a person at rest."""
    joints, _, _ = run(Mpc(NECK, smoothing_time_s=0.02), NECK, still(0.98), 300)
    arrived_s = np.argmax(np.abs(joints[:, 0] - 0.98) < 0.02) * NECK.servo_period_s
    assert arrived_s <= earliest_arrival_s(0.98, 0.02) + 3 * NECK.control_period_s
    assert joints[:, 0].max() < 0.98 + np.radians(0.12)  # 0.104 as measured
    assert joints[-1, 0] == pytest.approx(0.98, abs=0.005)


@pytest.mark.parametrize("name", ["reference", "slow"])
def test_the_smoother_follows_plans_that_use_their_limits(name):
    """A step of 60 deg, replanned at every control tick: the command is on each plan."""
    neck = load_neck(name)
    mpc, smoother = Mpc(neck), Smoother(neck, np.zeros(2))
    ts, path = neck.servo_period_s, still(np.radians(60.0))
    apart_deg = 0.0
    for tick in range(60):
        now = tick * neck.control_period_s
        command = smoother.command
        known, moves = forecast(mpc.forecast_times_s(now, now), path), {"joint_velocity_rad_s": command.velocity_rad_s}
        plan = mpc.plan(at_rest(neck, known, command.position_rad, now, command=command, **moves))
        for k in range(neck.servo_ticks_per_plan):
            followed = smoother.step(now + k * ts, plan)
            apart_deg = max(apart_deg, np.rad2deg(np.abs(followed - plan.at(now + k * ts).position_rad)).max())
    assert apart_deg < 1e-9
    assert np.rad2deg(smoother.command.position_rad[0]) > 50.0


def test_a_horizon_shorter_than_the_smoothing_time_is_refused():
    with pytest.raises(SettingsError, match=r"mpc\.horizon_s.*at least 0\.6 s"):
        Mpc(NECK, horizon_s=0.5, smoothing_time_s=0.3)


@pytest.mark.parametrize("name", ["reference", "slow"])
@pytest.mark.parametrize(("side", "towards"), [(1.0, True), (-1.0, False)])
def test_acquisition_of_a_walker_has_bounded_overshoot(name, side, towards):
    """From 60 deg, walking towards or away from the initial gaze; exact forecast."""
    neck = load_neck(name)
    speed_m_s = -1.2 if towards else 0.8

    def path(times):
        times = np.asarray(times)
        y = side * ((2.5 if towards else 1.2) + speed_m_s * times)
        return np.stack([np.full_like(y, 2.5), y, np.full_like(y, 0.2)], axis=-1)

    beside = look_at_rad(neck.geometry, path(0.0)) - [side * np.radians(60.0), 0.0]
    joints, _, errors = run(Mpc(neck), neck, path, 700, start_rad=beside)
    aims = look_at_rad(neck.geometry, path(neck.servo_period_s * np.arange(700)))[:, 0]
    assert np.degrees(np.max(side * (joints[:, 0] - aims))) < 1.0
    assert errors[600:].max() < 0.1


@pytest.mark.parametrize("name", ["reference", "reachy_mini"])
def test_acquisition_of_a_person_at_rest_has_bounded_overshoot(name):
    """From 20 deg, below the threshold of bounds: tracking takes over once the joint is slow."""
    neck = load_neck(name)
    joints, _, _ = run(Mpc(neck), neck, still(np.radians(20.0)), 300)
    assert np.degrees(joints[:, 0].max()) < 20.45


def test_acquisition_hysteresis_and_its_bounds():
    """By hand, degrees of error: acquisition from 15 until 2.6; bounds only above 25."""
    joint = Acquisition(NECK, 0, 0.1)

    def bounds(joint_deg, aim_deg, joint_deg_s=0.0, turning_deg_s=0.0):
        reference = np.radians([aim_deg, aim_deg + 1.0])
        found = joint.bounds_rad(*np.radians([joint_deg, joint_deg_s]), reference, np.radians(turning_deg_s))
        return None if found is None else np.degrees(found)

    assert bounds(0.0, 14.0) is None
    low, high = bounds(0.0, 16.0)
    assert low.max() < -360.0
    assert high.min() > 360.0
    assert bounds(0.0, 3.0) is not None
    assert bounds(0.0, 2.0) is None
    low, high = bounds(0.0, 30.0, turning_deg_s=10.0)
    assert high == pytest.approx([29.9, 30.9])  # less half a period at 10 deg/s
    assert low.max() < -360.0
    low, high = bounds(34.0, 30.0)  # overshot: approach from the other side
    assert low == pytest.approx([30.0, 31.0])
    assert bounds(31.0, 30.0) is None
    assert bounds(0.0, -30.0)[0] == pytest.approx([-30.0, -29.0])
    # On target but too fast to stay, acquisition goes on: 2.7 deg in the 0.1 s of the tracking program.
    low, high = bounds(-29.0, -30.0, joint_deg_s=-27.0)
    assert low.max() < -360.0  # after arrival the target may be passed
    assert high.min() > 360.0
    assert bounds(-29.0, -30.0, joint_deg_s=-25.0) is None
    assert bounds(0.0, 14.0) is None
    # Out of reach, the joint waits at its limit, the nearest reachable angle.
    assert bounds(79.0, 130.0) is None


def test_a_return_into_reach_causes_no_acquisition():
    """A person beyond the pan limit comes back into reach; the joint waits at its limit."""

    def returning(times):
        pan = np.radians(130.0 - 30.0 * np.asarray(times))
        return np.stack([2.5 * np.cos(pan), 2.5 * np.sin(pan), np.zeros_like(pan)], axis=-1)

    start_rad = (NECK.command_limits.position_max_rad[0], 0.0)
    _, _, errors = run(Mpc(NECK), NECK, returning, 800, start_rad=start_rad)
    assert errors[int(3.0 / NECK.servo_period_s) :].max() < 0.1
