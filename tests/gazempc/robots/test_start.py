"""The way in: a neck in the last bit of its range is brought slowly to where commands may be."""

import numpy as np
import pytest
from builders.live import NECK

from gazempc.errors import RobotError
from gazempc.neck.spec import load_neck
from gazempc.robots.robot import way_in_rad, wrong_reading
from gazempc.types import JointState


@pytest.mark.parametrize(("pan_deg", "tilt_deg"), [(75.0, 0.0), (-79.9, 40.0)])
def test_a_neck_in_the_last_bit_of_its_range_is_brought_in_slowly(pan_deg, tilt_deg):
    """An underdamped servo leaves commands less room than joints: clipped at once, the first one would be a jump."""
    axes = {name: getattr(NECK, name).model_copy(update={"damping_ratio": 0.4}) for name in ("pan", "tilt")}
    neck = NECK.model_copy(update=axes)
    start_rad = np.radians([pan_deg, tilt_deg])
    limits = neck.command_limits
    assert np.any(start_rad != limits.clip_position(start_rad))
    way = way_in_rad(neck, start_rad)
    motion = np.vstack([start_rad, way])
    assert np.abs(np.diff(motion, axis=0)).max() <= 0.3 * neck.servo_period_s + 1e-9
    assert np.all(np.abs(np.diff(motion, 2, axis=0)) / neck.servo_period_s**2 <= limits.acceleration_max_rad_s2 + 1e-6)
    np.testing.assert_allclose(way[-1], limits.clip_position(start_rad), atol=1e-9)
    assert way_in_rad(neck, np.zeros(2)).shape == (0, 2)


@pytest.mark.parametrize(
    ("state", "said"),
    [
        ((0.0, [0.1, 0.2]), "read_state() returned tuple, needed is a gazempc.JointState, or None"),
        (JointState(0.0, [0.1, 0.2], np.zeros(2)), "position_rad [0.1, 0.2], needed is an array of shape (2,)"),
        (JointState(0.0, np.zeros(3), np.zeros(2)), "position_rad array([0., 0., 0.]), needed is an array"),
        (JointState(0.0, np.zeros(2), None), "velocity_rad_s None, needed is an array of shape (2,): pan, tilt"),
    ],
)
def test_what_is_wrong_with_a_reading_is_said(state, said):
    assert said in wrong_reading(state, NECK)


def test_eyes_come_in_too_and_a_reading_must_have_them():
    neck = load_neck("reference_eyes")
    limits = neck.command_limits
    start_rad = np.array([0.0, 0.0, neck.position_max_rad[2], neck.position_min_rad[3]])
    way = way_in_rad(neck, start_rad)
    np.testing.assert_allclose(way[-1], limits.clip_position(start_rad), atol=1e-9)
    short = JointState(0.0, np.zeros(2), np.zeros(2))
    assert "shape (4,): pan, tilt, eye_pan, eye_tilt" in wrong_reading(short, neck)
    with pytest.raises(RobotError, match=r"eye_pan 40\.0, eye_tilt 0\.0 deg, outside its range"):
        way_in_rad(neck, np.radians([0.0, 0.0, 40.0, 0.0]))
