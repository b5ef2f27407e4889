"""Joints ahead of time, against the simulated servo that executes the same commands."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gazempc.neck.ahead import JointAhead, SettledJoints
from gazempc.neck.servo import DelayedServo
from gazempc.neck.spec import load_neck

NOW = 100  # servo periods
REFERENCE = load_neck("reference")
DEAD_TIMES_S = [0.4, 0.4012, 0.003, 0.0375, 0.0, 0.005, 0.1, 0.0049999, 0.0050001]


def with_joints(dead_times_s, rate_hz, zeta):
    """The reference neck with other dead times and rates."""
    axes = {
        name: axis.model_copy(update={"dead_time_s": dead_s, "damping_ratio": zeta})
        for name, axis, dead_s in zip(("pan", "tilt"), REFERENCE.axes, dead_times_s, strict=True)
    }
    control_hz = rate_hz if rate_hz != 200.0 else 50.0
    return REFERENCE.with_axes(axes).model_copy(update={"servo_rate_hz": rate_hz, "control_rate_hz": control_hz})


def executed(axis, commands, period_s):
    """States at each tick of a joint that starts at 0.1 and is sent the commands."""
    joint, states = DelayedServo(axis, 0.1), []
    for k, command in enumerate(commands):
        joint.advance_to(k * period_s)
        states.append(joint.state)
        joint.send(float(command))
    return states


@pytest.mark.parametrize(("neck", "dead_time_s"), [("reference", None), ("reachy_mini", 0.0), ("fetch", 0.0613)])
def test_it_is_where_the_simulated_joint_will_be(neck, dead_time_s):
    spec = load_neck(neck)
    axis = spec.pan if dead_time_s is None else spec.pan.model_copy(update={"dead_time_s": dead_time_s})
    period_s, at = spec.servo_period_s, [0, 1, 7, 20, 45]
    commands = 0.1 + np.cumsum(np.random.default_rng(1).normal(0.0, 0.02, 160))
    states = executed(axis, commands, period_s)
    ahead = JointAhead(axis, period_s, period_s * np.array(at, dtype=np.float64))
    found = ahead(*states[NOW], commands[:NOW], commands[NOW:])
    np.testing.assert_allclose(found, [states[NOW + k][0] for k in at], atol=1e-12)


def test_between_periods_it_is_on_the_line():
    ahead = JointAhead(REFERENCE.pan, 0.005, 0.005 * np.array([2.0, 2.25, 3.0]))
    early, between, late = ahead(0.3, 0.8, np.linspace(0.0, 1.0, 90), np.empty(0))
    assert between == pytest.approx(0.75 * early + 0.25 * late)


@given(
    dead_times_s=st.tuples(*[st.one_of(st.sampled_from(DEAD_TIMES_S), st.floats(0.0, 0.6))] * 2),
    rate_hz=st.sampled_from([200.0, 50.0, 120.0]),
    zeta=st.sampled_from([0.3, 0.9, 1.5]),
    commands=st.lists(st.floats(-1, 1), min_size=1, max_size=40),
    committed=st.lists(st.floats(-1, 1), max_size=4),
)
def test_the_settled_state_is_where_the_joints_will_be(dead_times_s, rate_hz, zeta, commands, committed):
    """What is sent after the committed commands cannot act before the dead time is over: the joints must end up there.

    Pan and tilt have dead times of their own. The tolerance is that of times, 1 ns: by so much the last command may
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
    settled = SettledJoints(neck, count)(*now, *both)
    for servo, dead_s, foreseen in zip(servos, dead_times_s, settled.T, strict=True):
        for k, command in enumerate(committed):
            servo.send(command)
            servo.advance_to((len(commands) + k + 1) * period_s)
        servo.send(5.0)
        servo.advance_to((len(commands) + count) * period_s + dead_s)
        np.testing.assert_allclose(servo.state, foreseen, atol=1e-6)
