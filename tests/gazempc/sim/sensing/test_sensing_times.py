"""Frame sampling, loss, delay and stamps, and the field of view."""

import numpy as np
import pytest
from builders.recordings import synthetic
from builders.replays import QUICK, replayed
from builders.sensing import seen, sensor, standing

from gazempc.neck.kinematics import gaze_ray, look_at_rad, seen_from_head
from gazempc.neck.spec import Geometry, load_neck
from gazempc.sim.sensor import observe

LONG = standing(300.0)


def captures_and_arrivals(recording, seed=1, **fields):
    sightings = observe(recording, sensor(**fields), seed)
    return np.array([s.observation.capture_time_s for s in sightings]), np.array([s.arrival_s for s in sightings])


def test_latency_jitter_is_uniform_and_leaves_stamps_exact():
    walk = standing(200.0)
    timing = {"latency_jitter_s": 0.21, "keeps_order": False}
    captures, arrivals = captures_and_arrivals(walk, latency_s=0.04, timing=timing)
    assert (np.diff(arrivals) >= 0).all()
    assert np.sort(captures) == pytest.approx(walk.times_s)
    assert (np.diff(captures) < 0).mean() > 0.2
    latency = arrivals - captures
    assert (latency.min(), latency.mean(), latency.max()) == pytest.approx((0.04, 0.145, 0.25), abs=0.003)


def test_in_order_delivery_delays_later_frames():
    walk = standing(60.0)
    timing = {"latency_jitter_s": 0.21}
    captures, arrivals = captures_and_arrivals(walk, timing=timing)
    np.testing.assert_array_equal(captures, walk.times_s)
    free_captures, free_arrivals = captures_and_arrivals(walk, timing=timing | {"keeps_order": False})
    alone = free_arrivals[np.argsort(free_captures)]
    for i, arrival in enumerate(arrivals):
        assert arrival == max(alone[: i + 1])


def test_stamp_errors_do_not_change_arrivals():
    walk = standing(200.0)
    stamps, arrivals = captures_and_arrivals(walk, timing={"stamp_offset_s": 0.06, "stamp_noise_s": 0.004})
    np.testing.assert_array_equal(arrivals, walk.times_s)
    error = stamps - walk.times_s
    assert error.mean() == pytest.approx(0.06, abs=0.0002)
    assert error.std() == pytest.approx(0.004, rel=0.03)


def test_frame_intervals_exceed_the_nominal_period_by_jitter():
    """4 to 30 frames a second, irregular, of a recording of 1000."""
    walk = standing(60.0, rate_hz=1000.0)
    waits = np.diff(captures_and_arrivals(walk, timing={"frame_jitter_s": 0.25 - 1 / 30})[0])
    assert (waits.min(), waits.max()) == pytest.approx((1 / 30, 0.25), abs=0.002)
    assert waits.mean() == pytest.approx((1 / 30 + 0.25) / 2, rel=0.05)


def test_loss_bursts_have_the_stated_durations_and_intervals():
    loss = {"mean_interval_s": 2.0, "duration_min_s": 0.3, "duration_max_s": 1.0}
    captures, _ = captures_and_arrivals(LONG, loss=loss)
    gaps = np.diff(captures)
    gaps = gaps[gaps > 0.05]
    assert gaps.min() >= 0.3
    # Sometimes the next one begins before a frame is taken.
    assert (gaps > 1.0 + 2 / 30).mean() < 1.5 * (1 - np.exp(-1 / 30 / 2.0))
    assert np.median(gaps) == pytest.approx(0.65 + 1 / 30, abs=0.08)
    assert captures.size / LONG.times_s.size == pytest.approx(2.0 / 2.65, abs=0.04)
    assert gaps.size == pytest.approx(300 / 2.65, rel=0.15)


@pytest.mark.parametrize(
    ("head_m", "visible"),
    [
        ([2.0, 1.5, 0.0], True),  # 36.9 deg
        ([2.0, 1.6, 0.0], False),  # 38.7 deg
        ([2.0, 0.0, 1.2], True),  # 31.0 deg
        ([2.0, 0.0, 1.4], False),  # 35.0 deg
        ([-2.0, 0.0, 0.0], False),
    ],
)
def test_a_view_of_75_by_65_degrees(head_m, visible):
    """A person in view for the first second, then here."""
    walk = standing(2.0)
    walk.truth.head_position_m[30:] = head_m
    found = seen(walk, view={"horizontal_deg": 75.0, "vertical_deg": 65.0})
    assert len(found) == (60 if visible else 30)


def test_view_limits_use_true_heads_and_range_limits_measured_ones():
    walk = standing(30.0)
    view = {"horizontal_deg": 75.0, "vertical_deg": 65.0}
    assert len(seen(walk, across={"noise_m": 2.0}, view=view)) == 900
    share = len(seen(walk, along={"noise_m": 0.5}, range_max_m=2.5)) / 900
    assert share == pytest.approx(0.5, abs=0.06)


GEOMETRY = Geometry(tilt_axis_in_pan_m=(0.02, 0.01, 0.05), eye_in_tilt_m=(0.04, -0.02, 0.03))


def observed(on, width_deg, start_offset_deg=0.0):
    """Capture times of the observed frames of a walk past the robot."""
    view = {"on": on, "horizontal_deg": width_deg, "vertical_deg": 60.0}
    settings = QUICK.model_copy(update={"start_offset_deg": start_offset_deg})
    log = replayed(synthetic("subject03_R4"), "lookahead", settings=settings, sensor=sensor(latency_s=0.066, view=view))
    return log.capture_time_s


def test_the_gaze_target_is_at_the_centre_of_a_head_mounted_view():
    target_m = np.array([1.5, -0.8, 0.6])
    angles_rad = look_at_rad(GEOMETRY, target_m)
    distance_m = np.linalg.norm(target_m - gaze_ray(GEOMETRY, angles_rad)[0])
    assert seen_from_head(GEOMETRY, angles_rad, target_m) == pytest.approx([distance_m, 0.0, 0.0], abs=1e-12)


def test_a_turning_view_keeps_a_person_who_leaves_a_fixed_one():
    everything = synthetic("subject03_R4").times_s.size - 3  # which would arrive after the end
    assert observed("head", 30.0).size == everything
    assert observed("base", 30.0).size < 0.5 * everything


def test_people_are_observed_once_they_enter_the_turned_view():
    """The neck is at rest until then, so the view is the initial one."""
    walk, neck = synthetic("subject03_R4"), load_neck("reference")
    bearing_rad = look_at_rad(neck.geometry, walk.truth.head_position_m)[:, 0]
    start_rad = min(bearing_rad[0] + np.radians(45.0), neck.position_max_rad[0])
    inside = np.abs(bearing_rad - start_rad) <= np.radians(30.0)
    first_s = walk.times_s[np.argmax(inside)]
    assert first_s > 1.0
    # The head is tilted: the edge of its view is a frame off the vertical plane.
    assert observed("head", 60.0, start_offset_deg=45.0)[0] == pytest.approx(first_s, abs=1.5 / 30)
