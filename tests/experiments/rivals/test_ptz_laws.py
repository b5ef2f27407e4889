"""The laws of cameras: AutoPTZ, obs-face-tracker, the OpenCV tutorial and Frigate."""

import numpy as np
import pytest
from builders.rival_bench import CAMERA, NECK, Plant, camera, neck_with, ramp, run, standing

from experiments.rivals.laws.cameras import AutoPtz, ObsFaceTracker, PixelPid, visca_speed
from experiments.rivals.laws.frigate import CornerFilter, Frigate, MoveTime

TOP = neck_with(velocity_max_rad_s=1.0)


def frames(course, rate_hz=30.0):
    """Pan commands, one per frame, from the arrival of the first frame on."""
    return course.command[np.round(np.arange(0.1, course.time_s[-1], 1.0 / rate_hz) * 1000).astype(int) + 2, 0]


def test_autoptz_speed_ramps_up_by_3_a_second_and_stops_at_once():
    course = run(AutoPtz(TOP, CAMERA), standing(42.0), 1.0, Plant(dead_time_s=2.0), seen=lambda t: t < 0.5)
    u = frames(course)
    np.testing.assert_allclose(u[:4], [0.1, 0.2, 0.3, 0.4], atol=3e-3)
    lost = course.time_s > 0.5 + 0.1 + 1.6 / 30
    assert (course.command[lost] == 0.0).all()
    assert np.abs(course.command[course.time_s < 0.55]).max() > 0.5


def test_autoptz_has_a_dead_zone_with_hysteresis():
    """0.35 and 1.25 of a zone of 0.15 half images are 3.0 and 10.6 deg; a slow face has no velocity estimate."""
    still = run(AutoPtz(NECK, CAMERA), standing(2.9), 1.0, Plant(dead_time_s=99.0))
    assert (still.command == 0.0).all()
    course = run(AutoPtz(NECK, CAMERA), ramp(1.0), 13.0, Plant(dead_time_s=99.0), dt_s=0.01)
    began_deg = course.person_deg[np.flatnonzero(course.command[:, 0])[0], 0]
    assert 10.6 < began_deg < 10.6 + 1.0 * (0.1 + 0.1 + 0.2)


def test_autoptz_speed_for_a_still_face_is_that_of_its_formula():
    """By hand: the error beyond the dead zone times 0.6 and the gain, to the power of 1.2."""
    course = run(AutoPtz(TOP, CAMERA), standing(20.0), 6.0, Plant(dead_time_s=99.0))
    error = np.tan(np.deg2rad(20.0)) - 0.35 * 0.15
    gain = 0.7 * (1.0 + 0.9 * max(error / 0.6, 0.55 * 0.05 / 0.3))
    assert course.command[-1, 0] == pytest.approx((gain * 0.6 * error) ** 1.2, rel=1e-3)


def test_visca_speeds_are_integer_steps():
    u = np.array([0.49, 0.5, 1.24, 1.25, 1.84, 1.85, 3.4, 3.6, 19.2, 40.0])
    np.testing.assert_array_equal(visca_speed(np.stack([u, -u], axis=-1))[:, 0], [0, 1, 1, 2, 2, 3, 3, 4, 19, 24])
    np.testing.assert_array_equal(visca_speed(np.stack([u, -u], axis=-1))[-2:, 1], [-19, -20])


@pytest.mark.parametrize(("fps", "gain"), [(30.0, 10.5), (60.0, 5.27)])
def test_the_gain_of_obs_face_tracker_scales_with_the_frame_interval(fps, gain):
    """At the second frame integral and low-pass are near zero: u is about gain * e / N."""
    seen_by = camera(rate_hz=fps)
    course = run(ObsFaceTracker(TOP, seen_by), standing(40.0), 0.2, Plant(dead_time_s=2.0), seen_by)
    error_px = np.tan(np.deg2rad(40.0)) * 640.0
    u = gain * error_px / np.sqrt(1280 * 720)
    expected = visca_speed(np.array([u, 0.0]))[0] / 24.0
    assert frames(course, fps)[1] == pytest.approx(expected, abs=1.01 / 24.0)


def test_the_integral_of_obs_face_tracker_rises_by_0_3_a_second():
    """Of 100 px after ten seconds u is 316 / 960 * 100 px / 30 * (1 + 3), and the derivative has decayed: 4.4."""
    person = standing(np.rad2deg(np.arctan(100.0 / 640.0)))
    course = run(ObsFaceTracker(TOP, CAMERA), person, 10.1, Plant(dead_time_s=99.0), dt_s=0.002)
    assert course.command[-1, 0] == pytest.approx(4.0 / 24.0)
    assert course.command[int(2.0 / 0.002), 0] < 3.0 / 24.0


def test_the_pixel_pid_ramp_error_is_rate_over_integral_gain():
    """The integral gain is 0.08 deg/s per pixel: at 2 deg/s the error is 25 px."""
    course = run(PixelPid(NECK, CAMERA), ramp(2.0), 20.0, dt_s=0.005)
    late_deg = np.rad2deg(np.arctan(2.0 / 0.08 / 160.0))
    assert course.lag_s(2.0, 5.0) * 2.0 == pytest.approx(late_deg, abs=0.5)


def test_the_pixel_pid_rounds_to_degrees_and_holds_its_integral_without_a_face():
    course = run(PixelPid(NECK, CAMERA), standing(20.0), 16.0, seen=lambda t: t < 12.0, dt_s=0.005)
    sent_deg = np.rad2deg(course.command)
    np.testing.assert_allclose(sent_deg, np.round(sent_deg), atol=1e-9)
    after = course.time_s > 12.4
    assert np.ptp(sent_deg[after, 0]) == 0.0
    assert sent_deg[-1, 0] == pytest.approx(20.0, abs=2.0)


PROMPT = camera(latency_s=0.02)
KNOWN = MoveTime(offset_s=0.5, slope_s=1.0, zero_move_s=0.5)


@pytest.mark.parametrize(("move_time", "px"), [(KNOWN, 131.0), (None, 49.0)])
def test_the_dead_band_of_a_200_px_box_is_131_or_49_px(move_time, px):
    """A motionless face has a velocity of zero, which is valid."""
    # A box of 200 px: its range follows from the face's height.
    range_m = 0.24 / 200.0 * 720.0 / (2.0 * np.tan(PROMPT.half_height_rad))
    for off_px, moves in ((px - 1.0, False), (px + 1.0, True)):
        law = Frigate(NECK, PROMPT, move_time=move_time, faces_tall=1.0)
        off_deg = np.rad2deg(np.arctan(off_px / 640.0))

        # The first frame has no velocity: the person is in the centre.
        def person(time_s, off_deg=off_deg):
            return (0.0 if time_s < 0.3 else off_deg, 0.0)

        course = run(law, person, 1.0, Plant(dead_time_s=9.0), PROMPT, range_m=range_m)
        assert bool(course.command[-1, 0]) is moves


def test_no_move_begins_during_another():
    course = run(Frigate(NECK, PROMPT), ramp(20.0), 5.0, Plant(0.3, 0.0, 0.6), PROMPT)
    changes = np.flatnonzero(np.diff(course.command[:, 0]))
    speed_deg_s = np.gradient(course.head_deg[:, 0], 0.001)
    assert changes.size >= 3
    assert np.abs(speed_deg_s[changes - 1]).max() < 1e-6


def test_a_calibrated_camera_leads_by_the_motion_during_the_move():
    """10 deg/s are 22.3 px in 0.2 s: the move grows by 22.3 px for each 0.2 s of its stated duration."""
    move_time = MoveTime(0.3, 0.79, 1.0)
    course = run(Frigate(NECK, PROMPT, move_time=move_time), ramp(10.0), 8.0, Plant(0.3, 0.0, 1.0), PROMPT)
    began = np.flatnonzero(np.diff(course.command[:, 0]))[-4:] + 1
    # The frame was captured 0.02 s before.
    seen = np.tan(np.deg2rad(course.person_deg[began - 20, 0] - course.head_deg[began, 0]))
    ahead = 10.0 * np.pi / 180.0 * (0.3 + 0.79 * seen)
    went_deg = np.rad2deg(course.command[began, 0]) - course.head_deg[began, 0]
    np.testing.assert_allclose(went_deg, 45.0 * (seen + ahead), atol=0.05)


def test_the_corner_filter_converges_to_a_constant_velocity():
    corners_px, step_px = np.array([[100.0, 50.0], [160.0, 130.0]]), np.array([7.0, -3.0])
    corner_filter = CornerFilter(corners_px)
    for k in range(1, 30):
        velocity = corner_filter.update(corners_px + k * step_px)
    np.testing.assert_allclose(velocity, [step_px, step_px], atol=0.01)
