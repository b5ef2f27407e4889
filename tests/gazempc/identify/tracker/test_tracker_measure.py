"""Estimation of known errors and timing of a tracker."""

import datetime
import tomllib

import numpy as np
import pytest
from builders.trackers import person_m, seen_m, track_of, wander

from gazempc.identify.tracker.measure import frame_times, measure_tracker
from gazempc.identify.tracker.read import read_track
from gazempc.identify.tracker.sensor_file import sensor_toml

# Long enough to estimate a correlation time of 1 s; half of that without wander.
TIMES_S = np.arange(0.0, 30.0, 1.0 / 12.0)
SHORT_S = np.arange(0.0, 16.0, 1.0 / 20.0)


def measured(seed, times_s, **errors):
    rng = np.random.default_rng(seed)
    return measure_tracker(track_of(times_s, seen_m(rng, person_m(rng, times_s), times_s, **errors)))


def test_the_stated_standard_deviation_equals_the_deviation_over_recordings():
    times_s = np.arange(0.0, 12.0, 1.0 / 12.0)
    errors = {"along": (0.035, 0.0, 1.0), "across_deg": (0.08, 0.0, 1.0)}
    found = [measured(seed, times_s, **errors) for seed in range(24)]
    for pick in (lambda one: one.along.white, lambda one: one.across.white):
        stated = np.median([pick(one).half_width / 1.96 for one in found])
        happens = np.std([pick(one).value for one in found])
        assert 0.5 * stated < happens < 2.0 * stated
    assert sum(one.along.wander_is == "none" for one in found) >= 20


def test_jumps_are_detected_and_do_not_bias_other_estimates():
    rng = np.random.default_rng(4)
    position_m = seen_m(rng, person_m(rng, SHORT_S), SHORT_S, along=(0.01, 0.0, 1.0), across_deg=(0.1, 0.0, 1.0))
    for start in range(40, 300, 80):
        position_m[start : start + 6, 1] += 0.15
    one = measure_tracker(track_of(SHORT_S, position_m))
    assert one.jump_durations_s == pytest.approx(np.full(4, 5.0 / 20.0), abs=0.06)
    _, across_m = one.jump_sizes_m
    assert across_m == pytest.approx(np.full(4, 0.15), rel=0.15)
    assert one.jumps_across
    assert one.across.white.value == pytest.approx(np.deg2rad(0.1), rel=0.1)


def test_a_start_to_walk_is_not_a_jump():
    rng = np.random.default_rng(5)
    true_m = person_m(rng, SHORT_S)
    # Half a second to 1.2 m/s, three metres, and stop, after 9 s.
    true_m[:, 1] += np.interp(SHORT_S, [9.0, 9.5, 11.5, 12.0], [0.0, 0.3, 2.7, 3.0])
    position_m = seen_m(rng, true_m, SHORT_S, along=(0.01, 0.0, 1.0), across_deg=(0.1, 0.0, 1.0))
    one = measure_tracker(track_of(SHORT_S, position_m))
    assert one.jump_durations_s.size == 0
    assert 9.0 < one.still_s < 15.0


def test_a_noise_free_track_gives_an_upper_bound():
    one = measure_tracker(track_of(SHORT_S, person_m(np.random.default_rng(6), SHORT_S, walks=True)))
    assert one.along.hidden
    assert one.across.hidden
    assert one.across.white.value < np.deg2rad(0.05)


def test_yaw_errors_are_measured_despite_flips():
    rng = np.random.default_rng(1)
    yaw_rad = 3.0 + np.deg2rad(4.0) * rng.standard_normal(TIMES_S.size)
    yaw_rad += np.deg2rad(wander(rng, TIMES_S, 8.0, 0.8)[:, 0])
    yaw_rad[100:150] += np.pi
    position_m = seen_m(rng, person_m(rng, TIMES_S), TIMES_S, across_deg=(0.1, 0.0, 1.0), along=(0.01, 0.0, 1.0))
    wrapped_rad = np.angle(np.exp(1j * yaw_rad))
    one = measure_tracker(track_of(TIMES_S, position_m, wrapped_rad))
    assert one.head_yaw.wander_is == "known"
    assert np.rad2deg(one.head_yaw.white.value) == pytest.approx(4.0, rel=0.1)
    assert np.rad2deg(one.head_yaw.wander.value) == pytest.approx(8.0, rel=0.3)
    assert one.pelvis_yaw is None


# Independent measurements of the same tracker: range 1 to 6 %, bearing 0.04 to 0.1 deg.
@pytest.mark.slow
def test_errors_of_a_face_tracker_are_recovered(bags_dir):
    found = measure_tracker(read_track(bags_dir / "1p_FV_eng_1"))
    assert 0.01 < found.along.white.value < 0.08
    assert 0.02 < np.rad2deg(found.across.white.value) < 0.15
    assert found.frames.rate_hz == pytest.approx(30.0, rel=0.03)
    assert found.head_yaw is not None


# ---------------------------------------------------------------- timing


GRID_S = np.arange(600) / 30.0


@pytest.mark.parametrize("late_s", [np.zeros(600), np.where(np.arange(600) % 7 == 3, 0.025, 0.0)])
def test_late_frames_are_not_lost(late_s):
    found = frame_times(GRID_S + late_s)
    assert found.regular
    assert (found.single_share, found.gaps_s.size) == (0.0, 0)
    assert found.rate_hz == pytest.approx(30.0, rel=1e-3)
    assert found.jitter_s == pytest.approx(np.diff(GRID_S + late_s).std(), rel=1e-6, abs=1e-9)


def test_single_losses_and_gaps_are_distinguished():
    lost = np.zeros(600, dtype=bool)
    lost[[20, 60, 200, 250, 400, 450, 500, 550]] = True
    lost[101:113] = lost[301:307] = True
    rng = np.random.default_rng(0)
    found = frame_times((GRID_S + 0.002 * rng.standard_normal(600))[~lost])
    assert found.single_share == pytest.approx(8 / 600)
    assert found.gaps_s == pytest.approx([12 / 30, 6 / 30], rel=1e-3)
    assert found.rate_hz == pytest.approx(30.0, rel=1e-3)
    assert found.duration_s - found.gaps_s.sum() == pytest.approx(GRID_S[-1] - 18 / 30, rel=1e-2)


def test_an_irregular_tracker_loses_nothing():
    intervals_s = np.random.default_rng(1).uniform(1 / 30, 1 / 4, 400)
    intervals_s[200] = 2.0
    found = frame_times(np.cumsum(intervals_s))
    assert not found.regular
    assert found.single_share == 0.0
    assert found.gaps_s == pytest.approx([2.0 - np.median(intervals_s)], rel=1e-4)
    assert found.rate_hz == pytest.approx(1.0 / np.delete(intervals_s, 200).mean(), rel=1e-3)


def test_the_sensor_file_has_the_mean_interval_between_jumps():
    rng = np.random.default_rng(8)
    position_m = seen_m(rng, person_m(rng, SHORT_S), SHORT_S, along=(0.01, 0.0, 1.0), across_deg=(0.1, 0.0, 1.0))
    for start in range(20, 300, 20):  # 0.3 s in every second
        position_m[start : start + 6, 1] += 0.15
    track = track_of(SHORT_S, position_m)
    values = tomllib.loads(sensor_toml(measure_tracker(track), track, "new", "track.csv", datetime.date(2026, 1, 1)))
    assert values["jumps"]["mean_interval_s"] == pytest.approx(0.7, rel=0.15)
