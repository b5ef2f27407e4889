"""Faults of a tracker: freezing, yaw jumps, late first frames, unreachable forecasts."""

import dataclasses

import numpy as np
import pytest
from builders.loop import LoopBench, events, make_recorder
from builders.people import yaw_quat

from gazempc.loop.track import PersonTrack
from gazempc.people.tracker_faults import FrozenTracker, OrientationJumps, TrackStart
from gazempc.settings import LoopSettings
from gazempc.types import CameraView, Sighting
from predictors import ConstantVelocity, HeadObservation, OutOfOrderError, Walker


def sighting(time_s, head_m, sensor_m=None):
    return Sighting(time_s + 0.05, HeadObservation(time_s, head_m), sensor_m)


def frozen_at(path_m, rate_hz, sensor_m=None):
    """Times from the start at which a tracker with these positions counts as frozen."""
    tracker = FrozenTracker()
    times_s = np.arange(len(path_m)) / rate_hz
    moving = [None] * len(path_m) if sensor_m is None else sensor_m
    return [t for t, m, s in zip(times_s, path_m, moving, strict=True) if tracker.observe(sighting(t, m, s))]


def walk_then(stops_m_s2, rate_hz, seconds=4.0, speed_m_s=1.2):
    """A person walks for 2 s, brakes and stands; without noise."""
    times_s = np.arange(int(seconds * rate_hz)) / rate_hz
    braking_s = np.clip(times_s - 2.0, 0.0, speed_m_s / stops_m_s2)
    way_m = speed_m_s * np.minimum(times_s, 2.0) + speed_m_s * braking_s - 0.5 * stops_m_s2 * braking_s**2
    return np.stack([2.0 + 0.0 * way_m, way_m - 1.5, 0.3 + 0.0 * way_m], axis=1)


@pytest.mark.parametrize("rate_hz", [5.0, 30.0])
def test_a_tracker_frozen_during_a_walk_is_detected_after_half_a_second(rate_hz):
    path_m = walk_then(1.0, rate_hz)
    stop = int(1.5 * rate_hz)
    path_m[stop : stop + int(1.5 * rate_hz)] = path_m[stop]
    found_s = frozen_at(path_m, rate_hz)
    assert found_s[0] == pytest.approx((stop + 0.5 * rate_hz) / rate_hz, abs=1.01 / rate_hz)
    # Until the first different position.
    assert found_s[-1] == pytest.approx((stop + int(1.5 * rate_hz) - 1) / rate_hz)
    assert len(found_s) == round((found_s[-1] - found_s[0]) * rate_hz) + 1


@pytest.mark.parametrize(("rate_hz", "stops_m_s2"), [(16.0, 0.5), (30.0, 3.0), (60.0, 1.0)])
def test_braking_to_a_stand_without_noise_is_not_frozen(rate_hz, stops_m_s2):
    assert frozen_at(walk_then(stops_m_s2, rate_hz), rate_hz) == []


def test_standing_from_the_start_or_after_a_gap_is_not_frozen():
    stands = np.tile([2.0, 0.5, 0.3], (120, 1))
    assert frozen_at(stands, 30.0) == []
    # Lost for two seconds; then a person stands 3 m away.
    tracker = FrozenTracker()
    for i in range(60):
        assert not tracker.observe(sighting(i / 30.0, [2.0, 0.5, 0.3]))
    for i in range(60):
        assert not tracker.observe(sighting(4.0 + i / 30.0, [2.0, 3.5, 0.3]))


def test_tracker_noise_is_neither_walking_nor_frozen():
    rng = np.random.default_rng(0)
    stands = np.array([2.0, 0.5, 0.3]) + 0.03 * rng.standard_normal((120, 3))
    assert frozen_at(stands, 30.0) == []
    stands[60:] = stands[60]
    assert frozen_at(stands, 30.0) == []


def test_on_a_moving_head_freezing_is_detected_in_the_sensor_frame():
    """Frozen in the sensor frame, the position moves in the base frame; a standing person moves in the sensor frame."""
    frames = np.arange(90)
    pan_rad = 0.02 * frames
    turning = np.stack([2.0 * np.cos(pan_rad), 2.0 * np.sin(pan_rad), 0.3 + 0.0 * pan_rad], axis=1)
    in_sensor = np.where(frames[:, None] < 45, turning, [2.0, 0.0, 0.3])
    assert frozen_at(turning, 30.0, in_sensor)[0] == pytest.approx(2.0, abs=0.04)
    assert frozen_at(turning, 30.0) == []
    assert frozen_at(np.tile([2.0, 0.0, 0.3], (90, 1)), 30.0, in_sensor) == []


# ---------------------------------------------------------------- orientations


def seen(time_s, head_rad=None, pelvis_rad=None):
    quats = [None if yaw is None else yaw_quat(yaw) for yaw in (head_rad, pelvis_rad)]
    return HeadObservation(time_s, [2.0, 0.0, 0.3], *quats, head_yaw_sd_rad=0.1)


def known(jumps, observations):
    """Orientations kept per observation, and the number of events."""
    found = [jumps.without(o) for o in observations]
    kept = [(o.head_quat_wxyz is not None, o.pelvis_quat_wxyz is not None) for o, _ in found]
    return kept, sum(first for _, first in found)


def test_an_orientation_that_flips_at_every_frame_is_never_used():
    observations = [seen(i / 30.0, np.pi * (i % 2), 0.1) for i in range(90)]
    kept, events = known(OrientationJumps(), observations)
    assert kept == [(True, True)] + [(False, True)] * 89
    assert events == 1


def test_human_turns_and_wraps_at_pi_are_accepted():
    # 500 deg/s, the peak speed of heads, over full turns.
    observations = [seen(i / 10.0, np.radians(50.0) * i, -np.radians(50.0) * i) for i in range(30)]
    assert known(OrientationJumps(), observations) == ([(True, True)] * 30, 0)
    # A turn between distant frames, or across a frame without orientation, is plausible.
    observations = [seen(0.3 * i, np.pi * (i % 2)) for i in range(10)]
    assert known(OrientationJumps(), observations) == ([(True, False)] * 10, 0)
    observations = [seen(0.0, 0.0), seen(0.03), seen(0.06, 3.0)]
    assert known(OrientationJumps(), observations)[1] == 0


def test_a_flip_removes_the_orientation_only_and_is_one_event():
    jumps = OrientationJumps()
    jumps.without(seen(0.0, 0.0))
    found, first = jumps.without(seen(0.03, 3.0))
    assert (found.head_quat_wxyz, found.head_yaw_sd_rad, first) == (None, 0.1, True)
    assert not jumps.without(seen(0.06, 0.0))[1]
    assert not jumps.without(seen(0.03, 3.0))[1]  # out of order
    jumps.without(seen(2.0, 0.0))
    assert jumps.without(seen(2.03, 3.0))[1]


# ---------------------------------------------------------------- the first frames of a track


LATER_S = np.arange(0.5, 1.3, 0.1)


def frame(time_s, person_id=None, aside_m=0.0, confidence=None):
    """A person who passes at 1.2 m/s, with a noisy tracker."""
    noise_m = 0.01 * np.random.default_rng(round(1e3 * time_s)).standard_normal(3)
    head_m = np.array([2.5 + aside_m, 1.2 * time_s - 2.0, 0.4]) + noise_m
    return HeadObservation(time_s, head_m, person_id=person_id, confidence=confidence)


FRAMES = [frame(k / 30) for k in range(12)]


def assert_same(one, other):
    assert np.array_equal(one.means_base_m, other.means_base_m)
    assert np.array_equal(one.covariances_m2, other.covariances_m2)


@pytest.mark.parametrize("make", [Walker, ConstantVelocity])
def test_shuffled_first_frames_give_the_forecast_of_ordered_frames(make):
    in_order, predictor = make(), make()
    start = TrackStart(predictor)
    for k, each in zip((4, 2, 3, 0, 8, 6, 1, 7, 5, 9, 10, 11), FRAMES, strict=True):
        in_order.update(each)
        start.update(FRAMES[k])
    assert_same(predictor.forecast(LATER_S), in_order.forecast(LATER_S))


@pytest.mark.parametrize(
    ("come", "late"),
    [
        (FRAMES, frame(8.5 / 30)),  # the track is older than 0.3 s
        (FRAMES[8:], frame(0.0)),  # with this frame it would be older than 0.3 s
        (FRAMES[:5], FRAMES[2]),  # already in the track
        (FRAMES[:5], FRAMES[4]),
    ],
)
def test_other_late_and_repeated_frames_are_refused_without_effect(come, late):
    predictor = ConstantVelocity()
    start = TrackStart(predictor)
    for each in come:
        start.update(each)
    before = predictor.forecast(LATER_S)
    with pytest.raises(OutOfOrderError, match="not newer"):
        start.update(late)
    assert_same(predictor.forecast(LATER_S), before)


def test_the_loop_uses_late_first_frames_and_keeps_the_newest_time():
    bench, first_s = LoopBench(), (0.0, 1 / 30, 2 / 30)
    late = [Sighting(0.2 - 0.1 * t, HeadObservation(t, bench.head_m(t))) for t in first_s]
    log = bench.run(1.0, seen=lambda t: t not in first_s, extra=tuple(late))
    assert events(log) == {"no_observation_yet"}
    assert bench.loop.seen.capture_time_s == log.capture_time_s.max()
    is_late = log.capture_time_s < np.maximum.accumulate(log.capture_time_s)
    assert sorted(log.capture_time_s[is_late]) == pytest.approx(first_s)
    assert np.isnan(log.forecast_mean_base_m[is_late]).all()
    assert np.isfinite(log.forecast_mean_base_m[~is_late]).all()


@pytest.mark.parametrize(("make", "rate_hz", "frames"), [(Walker, 30, 10), (ConstantVelocity, 5, 6)])
def test_a_new_track_of_a_detector_is_not_extrapolated_before_six_frames_over_0_3_s(make, rate_hz, frames):
    predictor = make()
    start = TrackStart(predictor)
    for k in range(frames):
        start.update(frame(k / rate_hz, confidence=0.9))
        own = predictor.forecast(k / rate_hz + LATER_S)
        found, left = start.within_reach(own)
        assert not left
        assert np.array_equal(found.covariances_m2, own.covariances_m2)
        if k < frames - 1:
            assert found.means_base_m == pytest.approx(np.tile(frame(k / rate_hz).head_position_base_m, (8, 1)))
    assert found is own
    start.reset()
    start.update(frame(9.0, confidence=0.9))
    found, _ = start.within_reach(predictor.forecast(9.0 + LATER_S))
    assert found.means_base_m == pytest.approx(np.tile(frame(9.0).head_position_base_m, (8, 1)))


def test_a_track_without_a_stated_confidence_is_extrapolated_at_once():
    predictor = ConstantVelocity()
    start = TrackStart(predictor)
    for k in range(2):
        start.update(frame(k / 30))
    own = predictor.forecast(1 / 30 + LATER_S)
    assert start.within_reach(own)[0] is own


@pytest.mark.parametrize("speed_m_s", [2.9, 30.0])
def test_forecast_displacement_is_bounded_by_running_speed(speed_m_s):
    class Runs(ConstantVelocity):
        def forecast(self, times_s):
            own = super().forecast(times_s)
            return dataclasses.replace(
                own, means_base_m=[[2.5, speed_m_s * (t - own.issued_at_s), 0.4] for t in own.times_s]
            )

    track, recorder = PersonTrack(Runs(), LoopSettings()), make_recorder()
    for k in range(12):
        seen = HeadObservation(k / 30, np.array([2.5, 0.0, 0.4]))
        track.assimilate([Sighting(k / 30, seen)], k / 30, recorder)
    times_s = 11 / 30 + LATER_S
    found = track.forecast(times_s, 11 / 30, recorder)
    most_m = 0.3 + 3.0 * LATER_S
    assert found.means_base_m[:, 1] == pytest.approx(np.minimum(speed_m_s * LATER_S, most_m))
    assert ("forecast_out_of_reach" in recorder.events) == (speed_m_s > 3.0)


@pytest.mark.parametrize(("aside_m_s", "most_deg"), [(0.3, 90.0), (-3.0, 60.0)])
def test_forecasts_leave_the_picture_by_at_most_half_its_width(aside_m_s, most_deg):
    """The camera points 90 deg to the left; half of its field of view is 30 deg."""
    axes = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    view = CameraView(np.array([0.1, 0.0, 0.0]), axes, (np.pi / 6, np.pi / 8))
    track, recorder = PersonTrack(ConstantVelocity(), LoopSettings()), make_recorder()
    for k in range(16):
        seen = HeadObservation(k / 30, np.array([0.1 + aside_m_s * (k / 30 - 0.5), 0.8, 0.1]))
        track.assimilate([Sighting(k / 30, seen, view=view)], k / 30, recorder)
    found = track.forecast(0.5 + LATER_S, 0.5, recorder)
    off_m = found.means_base_m - view.position_base_m
    off_deg = np.rad2deg(np.arctan2(np.abs(off_m[:, 0]), off_m[:, 1]))
    assert off_deg.max() <= most_deg + 1e-6
    cut = abs(aside_m_s) > 1.0
    assert ("forecast_out_of_reach" in recorder.events) == cut
    assert not cut or off_deg[-1] == pytest.approx(60.0)
