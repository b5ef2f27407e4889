"""The yaw that turns the path: from the waist, from travel, and with its mean removed."""

from typing import Literal

import numpy as np
import pytest
from builders.people import FRAME_S, seen, turned_walk, yaw_quat
from scipy.spatial.transform import Rotation

from predictors import (
    ConstantVelocity,
    HeadObservation,
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


@pytest.mark.parametrize(("yaw_from", "waist_yaw"), [("travel", None), ("waist", 0.3)])
def test_a_constant_offset_is_removed_as_time_goes_on(yaw_from: Literal["waist", "travel"], waist_yaw: float) -> None:
    """The mean is the angle itself and is believed by T / (T + 0.5 s): 0.5 / (T + 0.5) of the angle is left."""
    weight, speed = 0.7, 1.2
    for frames in (10, 45, 300):
        removed = HeadPose(weight, yaw_from=yaw_from, offset_removed=True)
        kept, kalman = HeadPose(weight, yaw_from=yaw_from), ConstantVelocity()
        for predictor in (removed, kept, kalman):
            end_s = turned_walk(predictor, frames, waist_yaw=waist_yaw)
        # With the first frame nobody travels yet: the yaw is known from the second one on.
        known_s = end_s - (1 / 30 if yaw_from == "travel" else 0.0)
        left = np.radians(20.0) * 0.5 / (known_s + 0.5)
        assert removed.relative_yaw_rad() == pytest.approx(left, abs=1e-9)
        assert kept.relative_yaw_rad() == pytest.approx(np.radians(20.0), abs=1e-9)
        plain = kalman.forecast(end_s + 0.5).means_base_m
        speed = float(np.linalg.norm(kalman.state()[1][3:]))
        for predictor, angle in ((removed, left), (kept, np.radians(20.0))):
            bend_m = np.linalg.norm(predictor.forecast(end_s + 0.5).means_base_m - plain)
            assert bend_m == pytest.approx(weight * 0.5 * speed * 2 * np.sin(angle / 2), abs=1e-9)


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


def test_who_stops_keeps_the_last_yaw_for_half_a_second() -> None:
    head = HeadPose(yaw_from="travel")
    end_s = turned_walk(head, 60)
    at_m = np.array([2.0, 1.0, 0.4]) + 59 * FRAME_S * 1.2 * np.array([np.cos(0.3), np.sin(0.3), 0.0])
    known = []
    for i in range(1, 60):
        head.update(HeadObservation(end_s + i * FRAME_S, at_m, yaw_quat(2.5)))
        known.append(head.relative_yaw_rad() is not None)
    assert known[:15] == [True] * 15
    assert known[-15:] == [False] * 15


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
