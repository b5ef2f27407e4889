"""Limits and shares of human-like motion: laws of peak velocities become limits that the neck bears."""

import math

import numpy as np
import pytest

from gazempc.controllers.chain import EyeAim
from gazempc.errors import SettingsError
from gazempc.neck.human import eye_velocity_rad_s, head_velocity_rad_s, motor_scale, with_motion
from gazempc.neck.servo import DelayedServo
from gazempc.neck.spec import load_neck

NECKS = [load_neck(name) for name in ("reference_eyes", "furhat", "icub")]


def strong(axis):
    """A motor that bears everything, behind a quick servo."""
    limits = {"velocity_max_rad_s": 50.0, "acceleration_max_rad_s2": 5000.0, "jerk_max_rad_s3": 1e7}
    return axis.model_copy(update=limits | {"natural_frequency_rad_s": 250.0})


def peak_rad_s(axis, amplitude_rad):
    """Peak velocity of a joint that is sent the fastest symmetrical motion within velocity and acceleration."""
    a, v, step_s = axis.acceleration_max_rad_s2, axis.velocity_max_rad_s, 0.5e-3
    top = min(v, math.sqrt(a * amplitude_rad))
    total_s = amplitude_rad / top + top / a
    servo = DelayedServo(axis.model_copy(update={"dead_time_s": 0.0}), 0.0, 0.0)
    speeds = []
    for k in range(math.ceil((total_s + 1.0) / step_s)):
        t = k * step_s
        servo.advance_to(t)
        speeds.append(servo.state[1])
        left_s = max(total_s - t, 0.0)
        ramp_s = top / a
        done = min(0.5 * a * t**2, amplitude_rad) if t < ramp_s else top * (t - 0.5 * ramp_s)
        servo.send(done if left_s > ramp_s else amplitude_rad - 0.5 * a * left_s**2)
    return max(speeds)


def test_a_strong_neck_moves_as_fast_as_people_and_no_faster():
    """Sampled through the servo: the head within a tenth over shifts of 20 to 70 deg, the eyes over 10 to 30 deg."""
    eyes = {"pan": strong(NECKS[0].eyes.pan), "tilt": strong(NECKS[0].eyes.tilt)}
    neck = NECKS[0].model_copy(update={"pan": strong(NECKS[0].pan), "tilt": strong(NECKS[0].tilt), "eyes": eyes})
    human = with_motion(neck, "human")
    for shift_deg in (20.0, 70.0):
        amplitude_rad = math.radians(0.69 * shift_deg)
        assert peak_rad_s(human.pan, amplitude_rad) == pytest.approx(head_velocity_rad_s(amplitude_rad), rel=0.1)
    for eye_deg in (10.0, 30.0):
        amplitude_rad = math.radians(eye_deg)
        assert peak_rad_s(human.eyes.pan, amplitude_rad) == pytest.approx(eye_velocity_rad_s(amplitude_rad), rel=0.1)


@pytest.mark.parametrize("neck", NECKS, ids=lambda neck: neck.name)
def test_no_limit_is_raised_and_a_second_time_changes_nothing(neck):
    human = with_motion(neck, "human")
    for name in ("velocity_max_rad_s", "acceleration_max_rad_s2", "jerk_max_rad_s3"):
        assert np.all(getattr(human, name) <= getattr(neck, name))
    for name in ("dead_time_s", "servo_lag_s"):
        np.testing.assert_array_equal(getattr(human, name), getattr(neck, name))
    assert with_motion(neck, "robot") is neck
    assert 0.2 < motor_scale(neck.pan) < 1.0


def test_a_neck_without_eyes_is_refused():
    with pytest.raises(SettingsError, match="neck 'reference' has no eyes"):
        with_motion(load_neck("reference"), "human")


def test_the_eyes_get_the_rest_up_to_four_fifths_of_their_range():
    aim = EyeAim(with_motion(NECKS[0], "human"), np.zeros(1))
    asked_deg = np.array([[40.0, 20.0], [-40.0, -20.0], [120.0, -35.0]])
    shared_deg = np.rad2deg(aim.head_share_rad(np.deg2rad(asked_deg)))
    most_deg = np.rad2deg(0.8 * NECKS[0].command_limits.position_max_rad[2:])
    expected = [[0.69 * 40, 0.52 * 20], [-0.69 * 40, -0.08 * 20], [120.0 - most_deg[0], -35.0 + most_deg[1]]]
    np.testing.assert_allclose(shared_deg, expected, atol=1e-9)
    plain = np.deg2rad(asked_deg)
    assert EyeAim(NECKS[0], np.zeros(1)).head_share_rad(plain) is plain
