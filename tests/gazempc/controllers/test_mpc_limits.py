"""The MPC with any neck, any start and model errors: stable, and within the limits."""

import numpy as np
import pytest
from builders.control import NECK, at_rest, crossing, forecast, run, still
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.controllers.controller import CommandState, ControllerError, Situation
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.reactive import Reactive
from gazempc.loop.smoother import Smoother
from gazempc.neck.ahead import joints_after_dead_time
from gazempc.neck.spec import NeckSpec, load_neck
from predictors import Forecast

MPC = Mpc(NECK)
FUZZED = Mpc(NECK, horizon_s=0.3)


def variant(name="reference", **of_both_axes):
    content = load_neck(name).model_dump()
    for axis in ("pan", "tilt"):
        content[axis] |= of_both_axes
    return NeckSpec.model_validate(content)


def test_a_loaded_joint_at_rest_is_predicted_to_stay():
    command_rad, offset_rad = np.array([0.4, -0.2]), np.array([0.05, -0.03])
    situation = at_rest(NECK, forecast(np.zeros(1), still(0.0)), command_rad, offset_rad=offset_rad)
    np.testing.assert_allclose(situation.position_after_dead_time_rad, command_rad + offset_rad, atol=1e-12)
    np.testing.assert_allclose(situation.velocity_after_dead_time_rad_s, 0.0, atol=1e-12)


def test_a_constant_load_leaves_no_steady_state_error():
    """A load of 2 deg: no error with the MPC, 2 deg with look-ahead."""
    loaded = variant(load_offset_deg=2.0)
    _, _, errors = run(Mpc(NECK), loaded, still(0.3), 1500, start_rad=(0.3, 0.0), model=NECK)
    assert errors[-1] < 0.06
    _, _, errors = run(LookAhead(NECK), loaded, still(0.3), 800, start_rad=(0.3, 0.0), model=NECK)
    assert errors[-1] > 2.0


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "dead_time_s", "far_rad"), [(0.7, 0.05, 1.0), (0.7, 0.6, 0.5), (1.3, 0.6, -1.0)])
def test_the_loop_is_stable_with_a_dead_time_error_of_30_percent(scale, dead_time_s, far_rad):
    """A step of the person: the joint settles with small overshoot."""
    plant, model = variant(dead_time_s=dead_time_s), variant(dead_time_s=scale * dead_time_s)

    def known(now, times):
        return still(0.0 if now < 0.5 else far_rad)(times)

    joints, _, _ = run(Mpc(model, horizon_s=0.4), plant, still(far_rad), 1600, model=model, known=known)
    off_deg = np.rad2deg(joints[:, 0] - far_rad) * np.sign(far_rad)
    assert off_deg.max() < 1.0 + 0.12 * abs(np.rad2deg(far_rad))
    assert np.abs(off_deg[-200:]).max() < min(0.75, 0.6 * np.abs(off_deg[-600:-400]).max() + 0.01)


@pytest.mark.slow
@settings(max_examples=20)
@given(
    st.fixed_dictionaries(
        {
            "position_min_deg": st.floats(-170, -1),
            "position_max_deg": st.floats(1, 170),
            "velocity_max_rad_s": st.floats(0.05, 8),
            "acceleration_max_rad_s2": st.floats(0.2, 60),
            "jerk_max_rad_s3": st.floats(2, 3000),
            "natural_frequency_rad_s": st.floats(2, 60),
            "damping_ratio": st.floats(0.3, 2),
            "dead_time_s": st.floats(0, 0.6),
        }
    ),
    st.integers(0, 2**32 - 1),
)
def test_commands_are_within_limits_for_any_neck_state_and_target(axis, seed):
    """Thousands of plans: any joint state, jumping targets, also inside and behind the neck, any confidence."""
    rng = np.random.default_rng(seed)
    neck = variant(**axis)
    limits = neck.command_limits
    mpc, smoother = Mpc(neck, horizon_s=0.25), Smoother(neck, rng.uniform(-2, 2, 2))
    ts = neck.servo_period_s
    commands = [smoother.command.position_rad] * 3
    for tick in range(40):
        now = tick * neck.control_period_s
        times = mpc.forecast_times_s(now, now)
        means = rng.uniform(-4, 4, 3) + rng.uniform(-3, 3, 3) * (times - now)[:, None]
        if rng.random() < 0.3:
            means = np.tile(means[0] * 1e-3, (times.size, 1))
        covariance = np.nan if rng.random() < 0.1 else 10 ** rng.uniform(-6, 2)
        situation = Situation(
            joints_after_dead_time(neck, 0),
            start_s=now,
            forecast=Forecast(times, means, np.tile(covariance * np.eye(3), (times.size, 1, 1)), 0.0),
            command=smoother.command,
            joint_position_rad=rng.uniform(-3, 3, 2),
            joint_velocity_rad_s=rng.uniform(-10, 10, 2),
            joint_offset_rad=rng.normal(0, 0.05, 2),
            sent_rad=np.tile(smoother.command.position_rad, (200, 1)),
            committed_rad=np.zeros((0, 2)),
        )
        plan = mpc.plan(situation)
        assert plan.is_finite
        commands += [smoother.step(now + k * ts, plan) for k in range(neck.servo_ticks_per_plan)]
    x = np.array(commands)
    assert np.all(x <= limits.position_max_rad + 1e-9)
    assert np.all(x >= limits.position_min_rad - 1e-9)
    bounds = (limits.velocity_max_rad_s, limits.acceleration_max_rad_s2, limits.jerk_max_rad_s3)
    for order, limit in enumerate(bounds, start=1):
        # Third differences of angles carry 1e-16 / ts^3 of rounding.
        assert np.all(np.abs(np.diff(x, order, axis=0)) / ts**order <= limit * (1 + 1e-6) + 1e-8 / ts**order * 1e-5)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_a_start_outside_the_limits_softens_them_and_is_an_event(seed):
    """Commands at up to three times the limits: a finite plan without exception; the softened limit is named."""
    rng = np.random.default_rng(seed)
    limits = NECK.command_limits
    mpc = FUZZED
    times = mpc.forecast_times_s(0.0, 0.0)
    command = CommandState(
        limits.position_max_rad * rng.uniform(-3, 3, 2),
        limits.velocity_max_rad_s * rng.uniform(-3, 3, 2),
        limits.acceleration_max_rad_s2 * rng.uniform(-3, 3, 2),
    )
    situation = Situation(
        joints_after_dead_time(NECK, 0),
        0.0,
        forecast(times, still(rng.uniform(-3, 3))),
        command,
        rng.uniform(-3, 3, 2),
        rng.uniform(-9, 9, 2),
        np.zeros(2),
        np.zeros((100, 2)),
        np.zeros((0, 2)),
    )
    plan = mpc.plan(situation)
    assert plan.is_finite
    # An acceleration outside its limit is removed at the jerk limit: only the first knots may violate it.
    outside = np.any(np.abs(plan.velocity_rad_s[1:]) > limits.velocity_max_rad_s * (1 + 1e-4))
    assert not outside or "limits_softened" in plan.events


@settings(max_examples=8)
@given(
    st.sampled_from(["reference", "slow", "fetch", "pr2"]),
    st.sampled_from([Reactive, LookAhead, Mpc]),
    st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.floats(-2, 2)), min_size=2, max_size=5),
)
def test_the_limits_hold_for_all_walks_and_places(name, kind, places):
    """Jumping people, also behind and inside the robot; every shipped neck and controller."""
    neck = load_neck(name)
    points = np.array(places)

    def path(times):
        index = np.clip((np.atleast_1d(times) / 0.4).astype(int), 0, len(points) - 1)
        return points[index]

    joints, commands, _ = run(kind(neck), neck, path, 240)
    dt = neck.servo_period_s
    for x in (joints, commands):
        # Before the first tick the neck stood still, straight ahead.
        padded = np.vstack([np.zeros((3, 2)), x])
        assert np.all(padded <= neck.position_max_rad + 1e-9)
        assert np.all(padded >= neck.position_min_rad - 1e-9)
        bounds = (neck.velocity_max_rad_s, neck.acceleration_max_rad_s2, neck.jerk_max_rad_s3)
        for order, limit in enumerate(bounds, start=1):
            assert np.all(np.abs(np.diff(padded, order, axis=0)) / dt**order <= limit * (1 + 1e-6))


def test_nan_in_the_situation_is_a_controller_error():
    controller = Mpc(NECK)
    situation = Situation(
        joints_after_dead_time(NECK, 0),
        0.0,
        forecast(controller.forecast_times_s(0.0, 0.0), crossing),
        CommandState(np.full(2, np.nan), np.zeros(2), np.zeros(2)),
        np.zeros(2),
        np.zeros(2),
        np.zeros(2),
        np.zeros((100, 2)),
        np.zeros((0, 2)),
    )
    with pytest.raises(ControllerError, match="not finite"):
        controller.plan(situation)
