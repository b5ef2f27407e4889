"""The first frames of a track: a late one gives the same forecasts as if it had come in time."""

import dataclasses

import numpy as np
import pytest
from builders.loop import LoopBench, events, make_recorder

from gazempc.loop.track import PersonTrack
from gazempc.people.tracker_faults import TrackStart
from gazempc.settings import LoopSettings
from gazempc.types import CameraView, Sighting
from predictors import ConstantVelocity, HeadObservation, OutOfOrderError, Walker

LATER_S = np.arange(0.5, 1.3, 0.1)


def frame(time_s, person_id=None, aside_m=0.0, confidence=None):
    """A person who walks past at 1.2 m/s, seen by a noisy tracker."""
    noise_m = 0.01 * np.random.default_rng(round(1e3 * time_s)).standard_normal(3)
    head_m = np.array([2.5 + aside_m, 1.2 * time_s - 2.0, 0.4]) + noise_m
    return HeadObservation(time_s, head_m, person_id=person_id, confidence=confidence)


FRAMES = [frame(k / 30) for k in range(12)]


def taken_in(predictor, frames):
    start = TrackStart(predictor)
    for each in frames:
        start.update(each)
    return predictor.forecast(LATER_S)


def assert_same(one, other):
    assert np.array_equal(one.means_base_m, other.means_base_m)
    assert np.array_equal(one.covariances_m2, other.covariances_m2)


@pytest.mark.parametrize("make", [Walker, ConstantVelocity])
def test_shuffled_first_frames_give_the_forecast_of_the_walk_in_order(make):
    in_order = make()
    for each in FRAMES:
        in_order.update(each)
    shuffled = [FRAMES[k] for k in (4, 2, 3, 0, 8, 6, 1, 7, 5, 9, 10, 11)]
    assert_same(taken_in(make(), shuffled), in_order.forecast(LATER_S))


@pytest.mark.parametrize(
    ("come", "late"),
    [
        (FRAMES, frame(8.5 / 30)),  # the track is older than 0.3 s
        (FRAMES[8:], frame(0.0)),  # it would be by this frame
        (FRAMES[:5], FRAMES[2]),  # it is there already
        (FRAMES[:5], FRAMES[4]),
    ],
)
def test_other_late_frames_and_repeated_ones_are_refused_and_change_nothing(come, late):
    predictor = ConstantVelocity()
    start = TrackStart(predictor)
    for each in come:
        start.update(each)
    before = predictor.forecast(LATER_S)
    with pytest.raises(OutOfOrderError, match="not newer"):
        start.update(late)
    assert_same(predictor.forecast(LATER_S), before)


def test_in_the_loop_late_first_frames_are_used_and_the_newest_frame_stays_the_newest():
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
def test_no_forecast_leads_farther_than_a_person_can_get(speed_m_s):
    class Runs(ConstantVelocity):
        def forecast(self, times_s):
            own = super().forecast(times_s)
            return dataclasses.replace(
                own, means_base_m=[[2.5, speed_m_s * (t - own.issued_at_s), 0.4] for t in own.times_s]
            )

    track, recorder = PersonTrack(Runs(), LoopSettings()), make_recorder()
    for k in range(12):
        seen = HeadObservation(k / 30, np.array([2.5, 0.0, 0.4]))
        track.take_in([Sighting(k / 30, seen)], k / 30, recorder)
    times_s = 11 / 30 + LATER_S
    found = track.forecast(times_s, 11 / 30, recorder)
    most_m = 0.3 + 3.0 * LATER_S
    assert found.means_base_m[:, 1] == pytest.approx(np.minimum(speed_m_s * LATER_S, most_m))
    assert ("forecast_out_of_reach" in recorder.events) == (speed_m_s > 3.0)


@pytest.mark.parametrize(("aside_m_s", "most_deg"), [(0.3, 90.0), (-3.0, 60.0)])
def test_no_forecast_leads_farther_outside_the_picture_than_half_of_it(aside_m_s, most_deg):
    """The camera looks to the left by 90 deg; half of its picture are 30 deg."""
    axes = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    view = CameraView(np.array([0.1, 0.0, 0.0]), axes, (np.pi / 6, np.pi / 8))
    track, recorder = PersonTrack(ConstantVelocity(), LoopSettings()), make_recorder()
    for k in range(16):
        seen = HeadObservation(k / 30, np.array([0.1 + aside_m_s * (k / 30 - 0.5), 0.8, 0.1]))
        track.take_in([Sighting(k / 30, seen, view=view)], k / 30, recorder)
    found = track.forecast(0.5 + LATER_S, 0.5, recorder)
    off_m = found.means_base_m - view.position_base_m
    off_deg = np.rad2deg(np.arctan2(np.abs(off_m[:, 0]), off_m[:, 1]))
    assert off_deg.max() <= most_deg + 1e-6
    cut = abs(aside_m_s) > 1.0
    assert ("forecast_out_of_reach" in recorder.events) == cut
    assert not cut or off_deg[-1] == pytest.approx(60.0)
