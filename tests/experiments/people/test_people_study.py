"""Engagement on recordings, and the minimum time of a switch."""

import numpy as np
import pytest
from scipy.optimize import brentq

from experiments.people.study import decided, least_time_s
from gazempc.neck.spec import load_neck


@pytest.mark.slow
def test_engagement_is_correct_for_95_percent_of_decided_time(bags_dir, tmp_path):
    for metadata in sorted(bags_dir.glob("*/metadata.yaml"))[::2]:  # half of the bags suffices
        (tmp_path / metadata.parent.name).symlink_to(metadata.parent)
    found = decided(tmp_path)
    assert found.right_s + found.wrong_s > 60.0
    assert found.right_s / (found.right_s + found.wrong_s) >= 0.95


def test_the_minimum_time_equals_bang_bang_acceleration():
    """Without velocity and jerk limits half of the motion accelerates: angle = a t^2 / 4."""
    neck = load_neck("reference")
    limits = {"velocity_max_rad_s": 900.0, "acceleration_max_rad_s2": 10.0, "jerk_max_rad_s3": 1e8}
    quick = neck.model_copy(update={"pan": neck.pan.model_copy(update=limits)})
    acceleration = float(quick.command_limits.acceleration_max_rad_s2[0])
    turn_rad, cone_rad = np.deg2rad([60.0, 2.6])
    whole_s = 2.0 * np.sqrt(turn_rad / acceleration)
    arrives_s = brentq(lambda t: 0.5 * acceleration * (whole_s - t) ** 2 - cone_rad, 0.0, whole_s)
    lag_s = neck.pan.dead_time_s + neck.pan.servo_lag_s
    assert least_time_s(quick, 60.0) - lag_s == pytest.approx(arrives_s, abs=0.003)
