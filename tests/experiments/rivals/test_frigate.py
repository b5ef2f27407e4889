"""Frigate's stop and go, its dead zone, its calibration and the velocities that it believes."""

import numpy as np
import pytest
from builders.rival_bench import NECK, Plant, camera, ramp, run

from experiments.rivals.laws.frigate import CornerFilter, Frigate, MoveTime

PROMPT = camera(latency_s=0.02)
KNOWN = MoveTime(offset_s=0.5, slope_s=1.0, zero_move_s=0.5)


@pytest.mark.parametrize(("move_time", "px"), [(KNOWN, 131.0), (None, 49.0)])
def test_a_box_200_px_tall_is_followed_from_131_or_49_px_on(move_time, px):
    """A face that stands has a velocity of zero, which is a valid one."""
    # A box of 200 px: its range follows from the face's height.
    range_m = 0.24 / 200.0 * 720.0 / (2.0 * np.tan(PROMPT.half_height_rad))
    for off_px, moves in ((px - 1.0, False), (px + 1.0, True)):
        law = Frigate(NECK, PROMPT, move_time=move_time, faces_tall=1.0)
        off_deg = np.rad2deg(np.arctan(off_px / 640.0))

        # The first frame knows no velocity: there the person is in the middle.
        def person(time_s, off_deg=off_deg):
            return (0.0 if time_s < 0.3 else off_deg, 0.0)

        course = run(law, person, 1.0, Plant(dead_time_s=9.0), PROMPT, range_m=range_m)
        assert bool(course.command[-1, 0]) is moves


def test_no_move_begins_while_another_is_under_way():
    course = run(Frigate(NECK, PROMPT), ramp(20.0), 5.0, Plant(0.3, 0.0, 0.6), PROMPT)
    changes = np.flatnonzero(np.diff(course.command[:, 0]))
    speed_deg_s = np.gradient(course.head_deg[:, 0], 0.001)
    assert changes.size >= 3
    assert np.abs(speed_deg_s[changes - 1]).max() < 1e-6


def test_a_calibrated_camera_goes_further_by_what_the_person_walks_meanwhile():
    """10 deg/s are 22.3 px in 0.2 s: the move grows by that for each 0.2 s of the time that it is said to take."""
    move_time = MoveTime(0.3, 0.79, 1.0)
    course = run(Frigate(NECK, PROMPT, move_time=move_time), ramp(10.0), 8.0, Plant(0.3, 0.0, 1.0), PROMPT)
    began = np.flatnonzero(np.diff(course.command[:, 0]))[-4:] + 1
    # The frame was captured 0.02 s before.
    seen = np.tan(np.deg2rad(course.person_deg[began - 20, 0] - course.head_deg[began, 0]))
    ahead = 10.0 * np.pi / 180.0 * (0.3 + 0.79 * seen)
    went_deg = np.rad2deg(course.command[began, 0]) - course.head_deg[began, 0]
    np.testing.assert_allclose(went_deg, 45.0 * (seen + ahead), atol=0.05)


def test_the_corner_filter_learns_a_steady_velocity():
    corners_px, step_px = np.array([[100.0, 50.0], [160.0, 130.0]]), np.array([7.0, -3.0])
    corner_filter = CornerFilter(corners_px)
    for k in range(1, 30):
        velocity = corner_filter.update(corners_px + k * step_px)
    np.testing.assert_allclose(velocity, [step_px, step_px], atol=0.01)
