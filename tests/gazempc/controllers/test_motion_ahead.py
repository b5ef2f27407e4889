import numpy as np
import pytest

from gazempc.controllers.motion_ahead import MotionAhead
from gazempc.neck.servo import DelayedServo
from gazempc.neck.spec import load_neck

NOW = 100  # servo periods


@pytest.mark.parametrize("neck", ["reference", "reachy_mini", "fetch"])
@pytest.mark.parametrize("dead_time_s", [None, 0.0, 0.0613])
def test_it_is_where_the_simulated_joint_will_be(neck, dead_time_s):
    spec = load_neck(neck)
    axis = spec.pan if dead_time_s is None else spec.pan.model_copy(update={"dead_time_s": dead_time_s})
    period_s, at = spec.servo_period_s, [0, 1, 7, 20, 45]
    commands = 0.1 + np.cumsum(np.random.default_rng(1).normal(0.0, 0.02, 160))
    joint, states = DelayedServo(axis, 0.1), []
    for k, command in enumerate(commands):
        joint.advance_to(k * period_s)
        states.append(joint.state)
        joint.send(float(command))
    ahead = MotionAhead(axis, period_s, period_s * np.array(at, dtype=np.float64))
    found = ahead(*states[NOW], commands[:NOW], commands[NOW:])
    np.testing.assert_allclose(found, [states[NOW + k][0] for k in at], atol=1e-12)


def test_between_periods_it_is_on_the_line():
    axis, period_s = load_neck("reference").pan, 0.005
    ahead = MotionAhead(axis, period_s, period_s * np.array([2.0, 2.25, 3.0]))
    early, between, late = ahead(0.3, 0.8, np.linspace(0.0, 1.0, 90), np.empty(0))
    assert between == pytest.approx(0.75 * early + 0.25 * late)
