"""Joints that take speeds: the delayed servo against scipy's integration, and against a joint that takes angles."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from gazempc.neck.servo import DelayedServo
from gazempc.neck.spec import Axis, load_neck

REFERENCE = load_neck("reference").pan
# Time of sending and speed.
SPEEDS = ((0.0, 0.5), (0.1, -0.8), (0.37, 0.0), (0.5, 0.3))


def speed_axis(dead_time_s, zeta=0.9):
    changes = {"command": "velocity", "dead_time_s": dead_time_s, "damping_ratio": zeta}
    return REFERENCE.model_copy(update=changes)


def integrated(axis, until_s):
    """Velocity servo and its integral, by scipy, piece by piece between the times at which the speed changes."""
    wn, zeta = axis.natural_frequency_rad_s, axis.damping_ratio
    state, now_s, speed = np.zeros(3), 0.0, 0.0
    for sent_s, next_speed in (*SPEEDS, (np.inf, 0.0)):
        end_s = min(sent_s + axis.dead_time_s, until_s)
        if end_s > now_s:

            def rates(_, x, c=speed):
                return [x[1], x[2], wn**2 * (c - x[1]) - 2.0 * zeta * wn * x[2]]

            state = solve_ivp(rates, (now_s, end_s), state, rtol=1e-10, atol=1e-12).y[:, -1]
            now_s = end_s
        speed = next_speed
    return float(state[0]), float(state[1])


@pytest.mark.parametrize("zeta", [0.4, 1.0, 2.0])
def test_speeds_move_the_joint_as_in_scipy(zeta):
    axis = speed_axis(0.123, zeta)
    servo = DelayedServo(axis, 0.0)
    for sent_s, speed in SPEEDS:
        servo.advance_to(sent_s)
        servo.send(speed)
    for until_s in (0.55, 0.8, 2.0):
        servo.advance_to(until_s)
        assert servo.state == pytest.approx(integrated(axis, until_s), abs=1e-8)


def test_the_joint_ends_at_its_stops_and_leaves_them_at_once():
    servo = DelayedServo(speed_axis(0.0, 1.0), 0.0, stops_rad=(-0.1, 0.2))
    servo.send(1.0)
    servo.advance_to(5.0)
    assert servo.state == pytest.approx((0.2, 0.0), abs=1e-9)
    servo.send(-0.05)
    servo.advance_to(7.0)
    lag_s = speed_axis(0.0, 1.0).servo_lag_s
    assert servo.state == pytest.approx((0.2 - 0.05 * (2.0 - lag_s), -0.05), abs=1e-6)


def test_a_load_that_a_speed_cannot_have_is_refused():
    with pytest.raises(ValidationError, match="load_offset_deg"):
        Axis.model_validate(speed_axis(0.1).model_dump() | {"load_offset_deg": 1.0})
