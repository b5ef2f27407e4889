"""The model of the servo, against scipy's."""

import math

import numpy as np
import pytest
from builders.identification import REFERENCE
from scipy import signal

from gazempc.identify.estimate import bandwidth_hz
from gazempc.identify.excitation import ExcitationSettings, excite
from gazempc.identify.servo_fit import ServoModel


@pytest.mark.parametrize(("wn", "zeta"), [(6.0, 1.2), (12.0, 0.9), (25.0, 0.5), (10.0, 1.0)])
def test_model_is_the_transfer_function_that_scipy_simulates(wn, zeta):
    """lsim on a finer grid with its own delay, a whole number of that grid's steps."""
    motion = excite(REFERENCE, REFERENCE.rest_rad, ExcitationSettings(duration_s=8.0)).position_rad[:, 0]
    command_time = 0.005 * np.arange(motion.size)
    fine = 0.0005 * np.arange(10 * motion.size)
    delay_steps = 247  # 123.5 ms
    u = np.concatenate([np.full(delay_steps, motion[0]), np.repeat(motion, 10)])[: fine.size]
    _, q, _ = signal.lsim(signal.TransferFunction([wn**2], [1, 2 * zeta * wn, wn**2]), u, fine, interp=False)
    read = slice(1003, None, 37)
    model = ServoModel(command_time, motion, fine[read])
    np.testing.assert_allclose(model.delayed(model.motion(wn, zeta), 0.1235), q[read], atol=1e-7)


def test_free_motion_is_that_of_the_undriven_servo():
    wn, zeta, times = 12.0, 0.7, np.linspace(1.0, 4.0, 200)
    model = ServoModel(0.005 * np.arange(900), np.zeros(900), times)
    system = signal.StateSpace([[0, 1], [-(wn**2), -2 * zeta * wn]], [[0], [1]], [[1, 0]], [[0]])
    for column, initial in zip(model.free(wn, zeta).T, np.eye(2), strict=True):
        _, q, _ = signal.lsim(system, np.zeros(200), times - times[0], X0=initial)
        np.testing.assert_allclose(column, q, atol=1e-6)


@pytest.mark.parametrize(("wn", "zeta"), [(6.0, 0.5), (12.0, 0.9), (20.0, 3.0)])
def test_bandwidth_is_where_the_answer_is_3_db_down(wn, zeta):
    _, answer = signal.freqs([wn**2], [1, 2 * zeta * wn, wn**2], [2 * math.pi * bandwidth_hz(wn, zeta)])
    assert abs(answer[0]) == pytest.approx(1 / math.sqrt(2))
