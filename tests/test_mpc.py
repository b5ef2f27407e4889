"""The MPC controller: dead time, forecast and limits put together."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from gazempc.controllers import CommandState, ControllerError, LookAhead, Mpc, Reactive, Situation
from gazempc.controllers.ocp import predict
from gazempc.kinematics import gaze_error_rad, look_at
from gazempc.neck import NeckSpec, load_neck
from gazempc.observer import JointObserver
from gazempc.robots import SimulatedNeck
from gazempc.smoother import Smoother
from predictors import Forecast

NECK = load_neck("reference")


def forecast(times_s, path):
    times = np.asarray(times_s)
    return Forecast(times, path(times), np.zeros((times.size, 3, 3)), 0.0)


def run(controller, neck, path, ticks, start_rad=(0.0, 0.0), model=None, known=None):
    """Closed loop, as the loop does it; returns true joint angles, commands and the gaze error after each tick.

    The future is the true one, or what `known(now, times)` says of it. `neck` is simulated; controller, observer and
    smoother know `model`.
    """
    model = model or neck
    now = 0.0
    observer = JointObserver(model, np.array(start_rad), 0.0)
    smoother = Smoother(model, np.array(start_rad))
    robot = SimulatedNeck(neck, smoother.command.position_rad, lambda: now)
    robot.connect()
    sent = np.tile(smoother.command.position_rad, (400, 1))
    plan, joints, commands, errors = None, [], [], []
    for k in range(ticks):
        now = k * neck.servo_period_s
        true = robot.true_state()
        state = observer.update(now, robot.read_state())
        if k % neck.servo_ticks_per_plan == 0:
            situation = Situation(
                start_s=now,
                forecast=forecast(
                    controller.forecast_times_s(now, now), path if known is None else lambda t, now=now: known(now, t)
                ),
                command=smoother.command,
                joint_position_rad=state.position_rad,
                joint_velocity_rad_s=state.velocity_rad_s,
                joint_offset_rad=state.offset_rad,
                sent_rad=sent,
                committed_rad=np.zeros((0, 2)),
            )
            plan = controller.plan(situation)
        command = smoother.step(now, plan)
        sent = np.vstack([sent[1:], robot.send_command(command.position_rad)])
        observer.sent(sent[-1])
        joints.append(true.position_rad)
        commands.append(command.position_rad)
        errors.append(float(gaze_error_rad(neck.geometry, true.position_rad, path(np.array([now]))[0])))
    return np.array(joints), np.array(commands), np.rad2deg(errors)


def crossing(times):
    """A person who walks past at 1.2 m/s, 2.5 m away."""
    times = np.asarray(times)
    return np.stack([np.full_like(times, 2.5), 1.5 - 1.2 * times, np.full_like(times, 0.4)], axis=-1)


def test_with_the_true_future_the_gaze_is_on_the_person():
    _, _, errors = run(Mpc(NECK), NECK, crossing, 400, start_rad=look_at(NECK.geometry, crossing(0.0)).angles_rad)
    assert errors[300:].max() < 0.03


@pytest.mark.parametrize("dead_times", [(0.4, 0.4), (0.2513, 0.4), (0.4, 0.1037), (0.0, 0.003)])
def test_fractional_and_different_dead_times(dead_times):
    """Pan and tilt with dead times of their own that are no multiple of a tick: the error stays that of whole ones."""
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

    start = look_at(neck.geometry, path(0.0)).angles_rad
    _, _, errors = run(Mpc(neck), neck, path, 400, start_rad=start)
    assert errors[300:].max() < 0.1


def test_offsets_of_axes_and_eye():
    neck = load_neck("fetch")
    start = look_at(neck.geometry, crossing(0.0)).angles_rad
    _, _, errors = run(Mpc(neck), neck, crossing, 400, start_rad=start)
    assert errors[200:].max() < 0.1


def earliest_arrival_s(distance_rad, tolerance_rad, steps=60):
    """By linear programming: the first step from which on the joint can be within the tolerance, within limits."""
    p = predict(NECK.pan, NECK, steps, 300.0)
    limits = NECK.command_limits
    bounds = np.repeat(
        [limits.position_max_rad[0], limits.velocity_max_rad_s[0], limits.acceleration_max_rad_s2[0]], steps
    )
    limit_rows = np.vstack([p.command_from_jerk, -p.command_from_jerk])
    limit_values = np.concatenate([bounds, bounds])
    jerk = limits.jerk_max_rad_s3[0] / 300.0
    for first in range(steps):
        there = p.joint_from_jerk[first:]
        found = linprog(
            np.zeros(steps),
            A_ub=np.vstack([limit_rows, there, -there]),
            b_ub=np.concatenate(
                [
                    limit_values,
                    np.full(len(there), distance_rad + tolerance_rad),
                    np.full(len(there), tolerance_rad - distance_rad),
                ]
            ),
            bounds=(-jerk, jerk),
        )
        if found.success:
            return NECK.pan.dead_time_s + (first + 1) * NECK.control_period_s
    raise AssertionError("never")


def test_step_is_as_fast_as_the_limits_allow():
    """The arrival is that of the linear program, dead time included; least squares then overshoots by 2 deg."""

    def still(times):
        return np.tile([2.5 * np.cos(0.98), 2.5 * np.sin(0.98), 0.0], (np.asarray(times).size, 1))

    joints, _, _ = run(Mpc(NECK, smoothing_time_s=0.02), NECK, still, 300)
    arrived_s = np.argmax(np.abs(joints[:, 0] - 0.98) < 0.02) * NECK.servo_period_s
    assert arrived_s <= earliest_arrival_s(0.98, 0.02) + 2 * NECK.control_period_s
    assert joints[:, 0].max() < 0.98 + 0.04
    assert joints[-1, 0] == pytest.approx(0.98, abs=0.005)


def test_a_command_follows_the_plan_to_a_tenth_of_a_degree():
    controller = Mpc(NECK)
    smoother = Smoother(NECK, np.array([0.5, 0.1]))
    situation = Situation(
        0.0,
        forecast(controller.forecast_times_s(0.0, 0.0), crossing),
        smoother.command,
        np.array([0.5, 0.1]),
        np.zeros(2),
        np.zeros(2),
        np.tile([0.5, 0.1], (100, 1)),
        np.zeros((0, 2)),
    )
    plan = controller.plan(situation)
    ticks = range(int(0.8 / NECK.servo_period_s))
    followed = np.array([smoother.step(k * NECK.servo_period_s, plan).position_rad for k in ticks])
    wanted = np.array([plan.at(k * NECK.servo_period_s).position_rad for k in ticks])
    assert np.rad2deg(np.abs(followed - wanted)).max() < 0.1


@settings(max_examples=15)
@given(
    st.sampled_from(["reference", "slow", "fetch", "pr2"]),
    st.sampled_from([Reactive, LookAhead, Mpc]),
    st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.floats(-2, 2)), min_size=2, max_size=5),
)
def test_whoever_walks_wherever_the_limits_hold(name, kind, places):
    """People who jump about, also behind the robot and into it; every shipped neck and every controller."""
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
