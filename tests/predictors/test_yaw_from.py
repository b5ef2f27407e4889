"""The yaw that turns the path: from the waist, from travel, and with its mean removed."""

import numpy as np
import pytest
from builders.people import FRAME_S, seen, turned_walk
from scipy.spatial.transform import Rotation

from predictors import (
    ConstantVelocity,
    HeadPose,
)


@pytest.mark.parametrize("waist_yaw", [None, -2.0])
def test_yaw_from_travel_is_the_heads_turn_from_the_path(waist_yaw: float | None) -> None:
    """Where the waist points, or whether it is known, does not matter."""
    head, kalman = HeadPose(weight=1.0, yaw_from="travel"), ConstantVelocity()
    end_s = turned_walk(head, 60, waist_yaw=waist_yaw)
    turned_walk(kalman, 60)
    assert head.relative_yaw_rad() == pytest.approx(np.radians(20.0), abs=1e-9)
    now, ahead = kalman.forecast([end_s, end_s + 0.5]).means_base_m
    expected = now + Rotation.from_euler("z", 20.0, degrees=True).apply(ahead - now)
    np.testing.assert_allclose(head.forecast(end_s + 0.5).means_base_m[0], expected, atol=1e-9)


def test_a_swinging_yaw_keeps_its_swing_when_its_mean_is_removed() -> None:
    """The offset is that of the filtered yaw, frame by frame."""
    with_offset, without = (HeadPose(offset_removed=removed) for removed in (False, True))
    total = 0.0
    for i in range(90):
        angle = 0.3 + 0.2 * np.sin(i / 5)
        for predictor in (with_offset, without):
            predictor.update(seen(i * FRAME_S, np.array([2.0, 0.01 * i, 0.4]), 1.0 + angle, 1.0))
        filtered, time_s = with_offset.relative_yaw_rad(), i * FRAME_S
        total += filtered or 0.0
        expected = (filtered or 0.0) - total / (i + 1) * time_s / (time_s + 0.5)
        assert without.relative_yaw_rad() == pytest.approx(expected, abs=1e-12)


def test_a_new_track_forgets_the_offset_of_the_old_one() -> None:
    """Refusals for 0.75 s, then a track 5 m away whose head is turned the other way: its own mean alone is removed."""
    head = HeadPose(yaw_from="travel", offset_removed=True)
    end_s = turned_walk(head, 90)
    start_s = end_s + FRAME_S
    last_s = turned_walk(head, 100, np.radians(-10.0), start_s=start_s, start_m=(2.0, 6.0, 0.4))
    expected = np.radians(-10.0) * 0.5 / (last_s - start_s + 0.5)  # the new track has what was refused
    assert head.relative_yaw_rad() == pytest.approx(expected, abs=np.radians(0.1))
    head.reset()
    turned_walk(head, 30)
    fresh = HeadPose(yaw_from="travel", offset_removed=True)
    turned_walk(fresh, 30)
    assert head.relative_yaw_rad() == fresh.relative_yaw_rad()
