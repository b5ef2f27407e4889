import numpy as np
import pytest

from experiments.eyes.one_program import OneProgram
from gazempc.errors import SettingsError
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import load_neck
from tests.builders.control import run

EYES = load_neck("reference_eyes")
AIM_DEG = 60.0


def crossing(times_s):
    times = np.asarray(times_s, dtype=np.float64)
    return np.stack([np.full_like(times, 2.0), 1.3 * times - 1.5, np.full_like(times, 0.35)], axis=-1)


def beside(times_s):
    away = 2.0 * np.array([np.cos(np.deg2rad(AIM_DEG)), np.sin(np.deg2rad(AIM_DEG)), 0.0])
    return np.tile(away, (np.size(times_s), 1))


def test_head_and_eyes_together_stay_on_the_person():
    start = np.concatenate([look_at_rad(EYES.geometry, crossing(0.0)), [0.0, 0.0]])
    joints, _, error_deg = run(OneProgram(EYES), EYES, crossing, 500, start_rad=start)
    assert error_deg[250:].max() < 0.3
    # The head is not made to follow alone.
    assert 1.0 < np.rad2deg(np.abs(joints[100:, 2])).max() < 20.0


def test_a_large_shift_uses_the_eyes_to_their_limit_and_brings_them_back():
    joints, commands, error_deg = run(OneProgram(EYES), EYES, beside, 600, start_rad=np.zeros(4))
    eye_deg = np.rad2deg(joints[:, 2])
    assert 30.0 < eye_deg.max() <= EYES.eyes.pan.position_max_deg
    assert abs(eye_deg[-1]) < 5.0
    assert error_deg[-1] < 0.5
    speed = np.abs(np.diff(commands, axis=0)) / EYES.servo_period_s
    assert (speed <= EYES.command_limits.velocity_max_rad_s * (1 + 1e-6)).all()


@pytest.mark.parametrize("neck", ["reference", "reachy_mini_body"])
def test_a_neck_without_eyes_is_refused(neck):
    with pytest.raises(SettingsError, match="one program needs eyes"):
        OneProgram(load_neck(neck))
