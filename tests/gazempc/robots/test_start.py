"""Approach from outside of the command limits, and validation of readings."""

import numpy as np
import pytest
from builders.live import NECK

from gazempc.errors import RobotError
from gazempc.robots.robot import checked_reading, way_in_rad
from gazempc.types import JointState


def test_a_neck_outside_the_command_range_approaches_it_slowly():
    """An underdamped servo has a smaller command range than joint range: a clipped first command would be a jump."""
    neck = NECK.with_axes({"pan": NECK.pan.model_copy(update={"damping_ratio": 0.4})})
    start_rad = np.radians([-79.9, 40.0])
    limits = neck.command_limits
    assert np.any(start_rad != limits.clip_position(start_rad))
    way = way_in_rad(neck, start_rad)
    motion = np.vstack([start_rad, way])
    assert np.abs(np.diff(motion, axis=0)).max() <= 0.3 * neck.servo_period_s + 1e-9
    assert np.all(np.abs(np.diff(motion, 2, axis=0)) / neck.servo_period_s**2 <= limits.acceleration_max_rad_s2 + 1e-6)
    np.testing.assert_allclose(way[-1], limits.clip_position(start_rad), atol=1e-9)
    assert way_in_rad(neck, np.zeros(2)).shape == (0, 2)
    with pytest.raises(RobotError, match="outside its range"):
        way_in_rad(neck, np.radians([85.0, 0.0]))


@pytest.mark.parametrize("angle_rad", [1e11, -np.inf])
def test_a_reading_beyond_any_joint_is_refused_and_a_missing_angle_is_not(angle_rad):
    with pytest.raises(RobotError, match=r"read_state\(\) returned position_rad"):
        checked_reading(JointState(0.0, np.array([0.0, angle_rad]), np.zeros(2)), NECK)
    assert np.isnan(checked_reading(JointState(0.0, np.array([0.0, np.nan]), np.zeros(2)), NECK).position_rad[1])
