"""The delayed servo against closed forms and the matrix exponential; speed commands against SciPy's integration."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from gazempc.neck.ahead import JointAhead, JointsAfterDeadTime
from gazempc.neck.servo import DelayedServo, servo_model, zero_order_hold
from gazempc.neck.spec import Axis, load_neck

REFERENCE = load_neck("reference").pan
TICK_S = 0.005
DEAD_TIMES_S = [0.4012, 0.003, 0.0]


def axis(dead_time_s, wn=12.0, zeta=0.9):
    changes = {"dead_time_s": dead_time_s, "natural_frequency_rad_s": wn, "damping_ratio": zeta}
    return REFERENCE.model_copy(update=changes)


def step_response(times_s, wn, zeta):
    """Closed form of the response to a unit step at 0, zero before it."""
    t = np.maximum(times_s, 0.0)
    if zeta == 1.0:
        return 1.0 - np.exp(-wn * t) * (1.0 + wn * t)
    root = np.sqrt(complex(zeta**2 - 1.0))
    fast, slow = -wn * (zeta + root), -wn * (zeta - root)
    response = 1.0 - (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (fast - slow)
    return np.real(response)


def replay(joint, commands, look_s, period_s=TICK_S, start=0.0):
    """States at given times of a joint, initially at rest, with one command per period from time 0 on."""
    servo = DelayedServo(joint, start)
    sends = [(k * period_s, 1, float(u)) for k, u in enumerate(commands)]
    looks = [(float(t), 0, 0.0) for t in look_s]
    seen = []
    for time_s, is_send, command in sorted(sends + looks):
        servo.advance_to(time_s)
        if is_send:
            servo.send(command)
        else:
            seen.append(servo.state)
    return np.array(seen)


# ---------------------------------------------------------------- discretisation


@pytest.mark.parametrize("zeta", [0.2, 1.0, 2.0])
@pytest.mark.parametrize("dt_s", [1e-6, 0.005, 0.3])
def test_zero_order_hold_is_the_matrix_exponential(zeta, dt_s):
    wn = 12.0
    augmented = np.array([[0.0, 1.0, 0.0], [-(wn**2), -2 * zeta * wn, wn**2], [0.0, 0.0, 0.0]])
    joint = axis(0.0, wn, zeta)
    np.testing.assert_array_equal(servo_model(joint), augmented[:2])
    np.testing.assert_allclose(zero_order_hold(joint, dt_s), expm(augmented * dt_s)[:2], atol=1e-12)


# ---------------------------------------------------------------- delayed servo


@pytest.mark.parametrize("zeta", [0.3, 1.0, 1.6])
@pytest.mark.parametrize("dead_time_s", DEAD_TIMES_S)
def test_the_motion_is_the_superposition_of_step_responses(dead_time_s, zeta):
    """Random commands as sums of closed-form step responses."""
    commands = np.random.default_rng(6).uniform(-1, 1, 120)
    look_s = np.linspace(0.0011, 0.9, 77)
    steps = np.diff(np.concatenate([[0.0], commands]))
    expected = sum(step * step_response(look_s - k * TICK_S - dead_time_s, 12.0, zeta) for k, step in enumerate(steps))
    np.testing.assert_allclose(replay(axis(dead_time_s, zeta=zeta), commands, look_s)[:, 0], expected, atol=1e-9)


def test_a_dead_time_of_whole_ticks_is_not_rounded_up():
    """0.4 s is 80 ticks; rounding of k * 0.005 + 0.4 must not make it 81."""
    for start in range(0, 4000, 37):
        servo = DelayedServo(axis(0.4), 0.0, time_s=start * TICK_S)
        servo.send(1.0)
        servo.advance_to((start + 80) * TICK_S)
        assert abs(servo.state[0]) < 1e-12
        servo.advance_to((start + 81) * TICK_S)
        assert servo.state[0] == pytest.approx(step_response(np.array([TICK_S]), 12.0, 0.9)[0], abs=1e-9)


# ---------------------------------------------------------------- joints that take speeds


# Time of sending and speed.
SPEEDS = ((0.0, 0.5), (0.1, -0.8), (0.37, 0.0), (0.5, 0.3))


def speed_axis(dead_time_s, zeta=0.9):
    return axis(dead_time_s, zeta=zeta).model_copy(update={"command": "velocity"})


def integrated(joint, until_s):
    """Velocity servo and its integral by SciPy, piecewise between changes of the speed."""
    wn, zeta = joint.natural_frequency_rad_s, joint.damping_ratio
    state, now_s, speed = np.zeros(3), 0.0, 0.0
    for sent_s, next_speed in (*SPEEDS, (np.inf, 0.0)):
        end_s = min(sent_s + joint.dead_time_s, until_s)
        if end_s > now_s:

            def rates(_, x, c=speed):
                return [x[1], x[2], wn**2 * (c - x[1]) - 2.0 * zeta * wn * x[2]]

            state = solve_ivp(rates, (now_s, end_s), state, rtol=1e-10, atol=1e-12).y[:, -1]
            now_s = end_s
        speed = next_speed
    return float(state[0]), float(state[1])


@pytest.mark.parametrize("zeta", [0.4, 1.0, 2.0])
def test_speed_commands_equal_integration_by_scipy(zeta):
    joint = speed_axis(0.123, zeta)
    servo = DelayedServo(joint, 0.0)
    for sent_s, speed in SPEEDS:
        servo.advance_to(sent_s)
        servo.send(speed)
    for until_s in (0.55, 0.8, 2.0):
        servo.advance_to(until_s)
        assert servo.state == pytest.approx(integrated(joint, until_s), abs=1e-8)


def test_the_joint_stops_at_its_end_stops_without_windup():
    servo = DelayedServo(speed_axis(0.0, 1.0), 0.0, stops_rad=(-0.1, 0.2))
    servo.send(1.0)
    servo.advance_to(5.0)
    assert servo.state == pytest.approx((0.2, 0.0), abs=1e-9)
    servo.send(-0.05)
    servo.advance_to(7.0)
    lag_s = speed_axis(0.0, 1.0).servo_lag_s
    assert servo.state == pytest.approx((0.2 - 0.05 * (2.0 - lag_s), -0.05), abs=1e-6)


def test_a_load_on_a_speed_driven_joint_is_refused():
    with pytest.raises(ValidationError, match="load_offset_deg"):
        Axis.model_validate(speed_axis(0.1).model_dump() | {"load_offset_deg": 1.0})


# ---------------------------------------------------------------- ahead of time


NOW = 100  # servo periods
NECK = load_neck("reference")
AWKWARD_DEAD_TIMES_S = [0.4, 0.4012, 0.003, 0.0375, 0.0, 0.005, 0.1, 0.0049999, 0.0050001]


def with_joints(dead_times_s, rate_hz, zeta):
    """The reference neck with other dead times and rates."""
    axes = {
        name: axis.model_copy(update={"dead_time_s": dead_s, "damping_ratio": zeta})
        for name, axis, dead_s in zip(("pan", "tilt"), NECK.axes, dead_times_s, strict=True)
    }
    control_hz = rate_hz if rate_hz != 200.0 else 50.0
    return NECK.with_axes(axes).model_copy(update={"servo_rate_hz": rate_hz, "control_rate_hz": control_hz})


@pytest.mark.parametrize(("neck", "dead_time_s"), [("reference", None), ("reachy_mini", 0.0), ("fetch", 0.0613)])
def test_the_prediction_equals_the_simulated_joint(neck, dead_time_s):
    spec = load_neck(neck)
    axis = spec.pan if dead_time_s is None else spec.pan.model_copy(update={"dead_time_s": dead_time_s})
    period_s, at = spec.servo_period_s, [0, 1, 7, 20, 45]
    commands = 0.1 + np.cumsum(np.random.default_rng(1).normal(0.0, 0.02, 160))
    states = replay(axis, commands, period_s * np.arange(commands.size), period_s, 0.1)
    ahead = JointAhead(axis, period_s, period_s * np.array(at, dtype=np.float64))
    found = ahead(*states[NOW], commands[:NOW], commands[NOW:])
    np.testing.assert_allclose(found, [states[NOW + k][0] for k in at], atol=1e-12)


def test_between_periods_the_prediction_is_linear():
    ahead = JointAhead(NECK.pan, 0.005, 0.005 * np.array([2.0, 2.25, 3.0]))
    early, between, late = ahead(0.3, 0.8, np.linspace(0.0, 1.0, 90), np.empty(0))
    assert between == pytest.approx(0.75 * early + 0.25 * late)


@given(
    dead_times_s=st.tuples(*[st.one_of(st.sampled_from(AWKWARD_DEAD_TIMES_S), st.floats(0.0, 0.6))] * 2),
    rate_hz=st.sampled_from([200.0, 50.0, 120.0]),
    zeta=st.sampled_from([0.3, 0.9, 1.5]),
    commands=st.lists(st.floats(-1, 1), min_size=1, max_size=40),
    committed=st.lists(st.floats(-1, 1), max_size=4),
)
def test_the_state_after_the_dead_time_equals_the_simulated_joint(dead_times_s, rate_hz, zeta, commands, committed):
    """Commands after the committed ones cannot act within the dead time: the simulated joints must reach this state.

    Pan and tilt have different dead times. The tolerance corresponds to 1 ns, by which the last command may
    act early.
    """
    neck = with_joints(dead_times_s, rate_hz, zeta)
    period_s, count = neck.servo_period_s, len(committed)
    servos = [DelayedServo(axis, 0.1) for axis in neck.axes]
    sent = [0.1] * (int(max(dead_times_s) / period_s) + 2) + commands
    for k, command in enumerate(commands):
        for servo in servos:
            servo.send(command)
            servo.advance_to((k + 1) * period_s)
    now = np.transpose([servo.state for servo in servos])
    both = [np.repeat(np.array(each, dtype=float)[:, None], 2, axis=1) for each in (sent, committed)]
    after_dead_time = JointsAfterDeadTime(neck, count)(*now, *both)
    for servo, dead_s, foreseen in zip(servos, dead_times_s, after_dead_time.T, strict=True):
        for k, command in enumerate(committed):
            servo.send(command)
            servo.advance_to((len(commands) + k + 1) * period_s)
        servo.send(5.0)
        servo.advance_to((len(commands) + count) * period_s + dead_s)
        np.testing.assert_allclose(servo.state, foreseen, atol=1e-6)
