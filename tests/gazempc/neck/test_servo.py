"""The delayed servo against closed forms, python-control and itself without the delay."""

import numpy as np
import pytest
from scipy.linalg import expm

from gazempc.neck.servo import DelayedServo, servo_model, zero_order_hold
from gazempc.neck.spec import load_neck

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


def replay(joint, commands, look_s, period_s=TICK_S):
    """Positions at given times of a joint that starts at 0 and is sent one command a period, from time 0 on."""
    servo = DelayedServo(joint, 0.0)
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
def test_the_sum_of_all_steps_is_the_motion(dead_time_s, zeta):
    """Random commands as steps, each answered by the closed form."""
    commands = np.random.default_rng(6).uniform(-1, 1, 120)
    look_s = np.linspace(0.0011, 0.9, 77)
    steps = np.diff(np.concatenate([[0.0], commands]))
    expected = sum(step * step_response(look_s - k * TICK_S - dead_time_s, 12.0, zeta) for k, step in enumerate(steps))
    np.testing.assert_allclose(replay(axis(dead_time_s, zeta=zeta), commands, look_s)[:, 0], expected, atol=1e-9)


def test_a_whole_dead_time_in_decimal_seconds_ends_on_the_tick():
    """0.4 s is 80 ticks; rounding of k * 0.005 + 0.4 must not make it 81."""
    for start in range(0, 4000, 37):
        servo = DelayedServo(axis(0.4), 0.0, time_s=start * TICK_S)
        servo.send(1.0)
        servo.advance_to((start + 80) * TICK_S)
        assert abs(servo.state[0]) < 1e-12
        servo.advance_to((start + 81) * TICK_S)
        assert servo.state[0] == pytest.approx(step_response(np.array([TICK_S]), 12.0, 0.9)[0], abs=1e-9)
