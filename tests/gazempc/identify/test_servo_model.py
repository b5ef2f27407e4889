"""The model of the servo, against scipy's."""

import math

import numpy as np
import pytest
from builders.identification import REFERENCE
from scipy import signal

from gazempc.identify.estimate import bandwidth_hz
from gazempc.identify.excitation import ExcitationSettings, excite
from gazempc.identify.servo_fit import Z_95, ServoModel, robust_covariance


@pytest.mark.parametrize(("wn", "zeta"), [(6.0, 1.2), (25.0, 0.5), (10.0, 1.0)])
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
    np.testing.assert_allclose(model.delayed(model.motion(wn, zeta), 0.1235), q[read], atol=1e-6)


@pytest.mark.parametrize(("wn", "zeta"), [(6.0, 0.5), (20.0, 3.0)])
def test_bandwidth_is_where_the_answer_is_3_db_down(wn, zeta):
    _, answer = signal.freqs([wn**2], [1, 2 * zeta * wn, wn**2], [2 * math.pi * bandwidth_hz(wn, zeta)])
    assert abs(answer[0]) == pytest.approx(1 / math.sqrt(2))


def test_95_percent_intervals_hold_the_truth_where_errors_are_correlated_in_time():
    """Of a smooth regression with autoregressive errors; errors of channels that share a time are correlated, too."""
    rng, times, draws, rhos, channels = np.random.default_rng(0), 400, 150, (0.0, 0.5, 0.8, 0.95), 3
    t = np.arange(times) / 30.0
    jacobian = np.repeat(np.column_stack([np.sin(3.0 * t), np.cos(5.0 * t + 1.0)]), channels, axis=0)
    solve = np.linalg.pinv(jacobian)
    mixing = np.linalg.cholesky(0.5 * np.eye(channels) + 0.5)
    inside = np.zeros(2)
    for rho in np.repeat(rhos, draws):
        white = rng.standard_normal((times + 100, channels)) @ mixing.T
        errors = signal.lfilter([1.0], [1.0, -rho], white, axis=0)[100:].ravel()
        estimate = solve @ errors
        sd = np.sqrt(np.diag(robust_covariance(jacobian, errors - jacobian @ estimate, channels)))
        inside += np.abs(estimate) < Z_95 * sd
    share = inside / (draws * len(rhos))
    assert np.all((share >= 0.93) & (share <= 0.98)), share
