"""Multi-person tracking: association of detections with tracks; cues."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gazempc.people.company import Choice, Cues, Glance, Rhythm, Speech, Thinking
from gazempc.people.people import Became, People, middle_of
from predictors import ConstantVelocity, Forecast, HeadObservation, Walker

FRAME_S = 1.0 / 30.0
A_M, B_M = np.array([2.0, 0.0, 0.4]), np.array([2.0, 1.5, 0.4])
TIMES_S = np.arange(90) * FRAME_S


def people(coast_s=1.0):
    return People(ConstantVelocity, coast_s)


def straight(start_m, velocity_m_s, at_s):
    """Positions on a straight walk."""
    return np.asarray(start_m) + np.asarray(at_s)[..., None] * np.asarray(velocity_m_s)


def frame(time_s, positions_m, names=None, noise_m=0.0, rng=None):
    """Detections of one instant; None is a person out of sight."""
    names = names or [None] * len(positions_m)
    noise = np.zeros(3) if rng is None else noise_m * rng.standard_normal(3)
    return [
        HeadObservation(time_s, np.asarray(where) + noise, person_id=name)
        for where, name in zip(positions_m, names, strict=True)
        if where is not None
    ]


def shown(crowd, frames):
    """Process frames; returns the result of each detection, one list per frame."""
    return [crowd.observe(each) for each in frames]


def stand(crowd, places_m, seconds=0.5, names=None, from_s=0.0):
    """Process detections of standing people; returns the time of the last frame."""
    for k in range(round(seconds / FRAME_S)):
        crowd.observe(frame(from_s + k * FRAME_S, places_m, names))
    return from_s + (round(seconds / FRAME_S) - 1) * FRAME_S


def numbers_at(crowd, time_s):
    return [state.number for state in crowd.present(time_s)]


def test_false_detections_of_two_frames_start_no_track():
    crowd = people()
    found = shown(crowd, [frame(k * FRAME_S, [A_M, B_M] if k < 2 else [A_M]) for k in range(20)])
    assert [became for _, became in found[0]] == [Became.TENTATIVE] * 2
    assert numbers_at(crowd, 19 * FRAME_S) == [1]


@pytest.mark.parametrize("behind_m", [0.3, 1.5])
def test_crossing_walkers_keep_their_track_numbers_without_names(behind_m):
    one = straight([2.0, -1.5, 0.4], [0.0, 1.0, 0.0], TIMES_S)
    other = straight([2.0 + behind_m, 1.5, 0.4], [0.0, -1.0, 0.0], TIMES_S)
    crowd, rng = people(), np.random.default_rng(0)
    # The order of the detections varies and is not used.
    orders = [slice(None, None, -1 if k % 2 else 1) for k in range(TIMES_S.size)]
    frames = [frame(t, [one[k], other[k]][orders[k]], rng=rng, noise_m=0.01) for k, t in enumerate(TIMES_S)]
    found = [numbers[orders[k]] for k, numbers in enumerate(shown(crowd, frames))]
    whose = [[number for number, _ in each] for each in found[5:]]
    assert whose == [whose[0]] * len(whose)
    assert sorted(whose[0]) == [1, 2]


def test_swapped_names_do_not_swap_tracks():
    one = straight([2.0, -1.0, 0.4], [0.0, 0.8, 0.0], TIMES_S)
    other = one + np.array([0.0, 0.4, 0.0])
    crowd = people()
    swapped = [frame(t, [one[k], other[k]], ["a", "b"] if k < 45 else ["b", "a"]) for k, t in enumerate(TIMES_S)]
    found = shown(crowd, swapped)
    assert [number for number, _ in found[-1]] == [1, 2]
    assert [became for _, became in found[45]] == [Became.RENAMED] * 2
    assert [became for _, became in found[46]] == [Became.USED] * 2


def test_names_resolve_ambiguous_associations():
    """Two people 0.3 m apart with a position error of 0.15 m: positions alone are ambiguous."""

    def share_kept(names):
        crowd, rng = people(), np.random.default_rng(1)
        near_m = A_M + np.array([0.3, 0.0, 0.0])
        stand(crowd, [A_M, near_m], names=names)
        noise_m2 = 0.15**2 * np.eye(3)
        kept = []
        for t in TIMES_S:
            places_m = [where + 0.15 * rng.standard_normal(3) for where in (A_M, near_m)]
            seen = [replace(each, position_covariance_m2=noise_m2) for each in frame(0.5 + t, places_m, names)]
            kept.append([number for number, _ in crowd.observe(seen)] == [1, 2])
        return np.mean(kept)

    assert share_kept(["a", "b"]) == 1.0
    assert share_kept(None) < 0.95


def test_two_detections_of_one_person_are_one_track():
    crowd = people()
    twice = [frame(t, [A_M, A_M + np.array([0.1, 0.05, 0.0])], ["face", "body"]) for t in TIMES_S]
    found = shown(crowd, twice)
    assert numbers_at(crowd, TIMES_S[-1]) == [1]
    assert sum(became is Became.DUPLICATE for _, became in found[-1]) == 1


def test_late_first_detections_give_the_forecast_of_ordered_ones():
    walk = straight([2.0, -1.5, 0.4], [0.0, 1.0, 0.0], TIMES_S)
    in_order, shuffled = people(), people()
    found = []
    for k in range(8):
        in_order.observe(frame(TIMES_S[k], [walk[k]]))
    for k in (2, 0, 3, 1, 4, 5, 7, 6):
        found += shuffled.observe(frame(TIMES_S[k], [walk[k]]))
    assert found[1] == (0, Became.LATE)
    assert found[2] == (1, Became.ENTERED)
    assert [became for _, became in found].count(Became.LATE) == 3
    later_s = np.array([1.0, 1.5])
    expected_m = in_order.track(1).forecast(later_s).means_base_m
    np.testing.assert_array_equal(shuffled.track(1).forecast(later_s).means_base_m, expected_m)
    assert shuffled.track(1).newest.capture_time_s == TIMES_S[7]


@pytest.mark.parametrize(
    ("late_s", "there_m", "name"),
    [
        (2 * FRAME_S, [A_M], ""),  # already observed at that time
        (2.5 * FRAME_S, [A_M], "another"),
        (2.5 * FRAME_S, [A_M, A_M + np.array([0.0, 0.3, 0.0])], ""),  # it may be either one's
    ],
)
def test_ambiguous_late_first_detections_are_dropped(late_s, there_m, name):
    crowd = people()
    for k in range(5):
        crowd.observe(frame(k * FRAME_S, there_m, ["a", "b"][: len(there_m)]))
    late = replace(frame(late_s, [A_M])[0], person_id=name or None)
    assert crowd.observe([late]) == [(1, Became.OUT_OF_ORDER)]


def test_a_track_ends_after_the_coasting_time():
    crowd = people(coast_s=0.5)
    end_s = stand(crowd, [A_M, B_M])
    assert numbers_at(crowd, end_s + 0.4) == [1, 2]
    assert numbers_at(crowd, end_s + 0.6) == []
    assert crowd.track(1) is not None  # no later frame: frames may still be late
    stand(crowd, [A_M * 3], from_s=end_s + 0.7)
    assert crowd.track(1) is None


def test_a_return_under_the_same_name_keeps_the_number():
    crowd = people()
    end_s = stand(crowd, [A_M, B_M], names=["a", "b"])
    end_s = stand(crowd, [B_M], names=["b"], from_s=end_s + FRAME_S, seconds=3.0)
    assert numbers_at(crowd, end_s) == [2]
    end_s = stand(crowd, [A_M + 0.5, B_M], names=["a", "b"], from_s=end_s + FRAME_S)
    assert sorted(numbers_at(crowd, end_s)) == [1, 2]


def test_a_name_at_an_impossible_distance_is_another_person():
    crowd = people()
    end_s = stand(crowd, [A_M], names=["1"])
    # Seven metres farther a second and a half later, beyond any running speed.
    end_s = stand(crowd, [A_M + np.array([7.0, 0.0, 0.0])], names=["1"], from_s=end_s + 1.5)
    assert numbers_at(crowd, end_s) == [2]


def test_queued_observations_are_processed_on_demand():
    """The forecast of an unattended person equals that of an attended one."""
    walk = straight([2.0, -1.5, 0.4], [0.2, 1.0, 0.0], TIMES_S)
    crowd, alone = People(Walker), Walker()
    for k, t in enumerate(TIMES_S):
        crowd.observe(frame(t, [walk[k], B_M * 2]))
    for k, t in enumerate(TIMES_S):
        if t >= TIMES_S[-1] - 1.5:
            alone.update(frame(t, [walk[k]])[0])
    ahead_s = TIMES_S[-1] + np.array([0.25, 0.5, 1.0])
    np.testing.assert_allclose(
        crowd.track(1).forecast(ahead_s).means_base_m, alone.forecast(ahead_s).means_base_m, atol=1e-9
    )


@settings(max_examples=25)
@given(st.data())
def test_association_is_one_to_one_and_track_numbers_are_unique(data):
    crowd = people()
    seen = set()
    numbers = st.floats(-1e3, 1e3)
    for k in range(8):
        count = data.draw(st.integers(0, 5))
        late = data.draw(st.sampled_from([0.0, 0.0, 0.0, -0.2, 2.0]))
        places = [np.array([data.draw(numbers) for _ in range(3)]) for _ in range(count)]
        names = [data.draw(st.sampled_from([None, "a", "b"])) for _ in range(count)]
        found = crowd.observe(frame(k * FRAME_S + late, places, names))
        taken = [number for number, became in found if became in (Became.USED, Became.RENAMED, Became.ENTERED)]
        assert len(taken) == len(set(taken))
        now = numbers_at(crowd, k * FRAME_S + late)
        assert len(now) == len(set(now))
        seen |= set(now)
        assert all(np.isfinite(state.position_base_m).all() for state in crowd.present(k * FRAME_S + late))
    assert seen == set(range(1, max(seen, default=0) + 1))


@pytest.mark.parametrize(("rate_hz", "tracks_expected"), [(30.0, 1), (2.5, 1), (0.9, 0)])
def test_tracks_are_confirmed_above_a_minimum_frame_rate(rate_hz, tracks_expected):
    people = People(ConstantVelocity)
    for k in range(4):
        people.observe([HeadObservation(k / rate_hz, np.array([2.0, 0.0, 0.3]))])
    assert len(people.confirmed) == tracks_expected


def at(pan_deg, tilt_deg, range_m):
    pan, tilt = np.radians([pan_deg, tilt_deg])
    where = range_m * np.array([np.cos(tilt) * np.cos(pan), np.cos(tilt) * np.sin(pan), np.sin(tilt)])
    return Forecast(np.zeros(1), where[None], np.eye(3)[None], 0.0)


@pytest.mark.parametrize(
    ("people", "pan_deg", "tilt_deg"),
    [
        ([(10.0, 5.0, 2.0)], 10.0, 5.0),
        ([(-20.0, 0.0, 2.0), (40.0, 10.0, 4.0)], 10.0, 5.0),
        ([(-20.0, 0.0, 2.0), (39.0, 3.0, 2.0), (40.0, 10.0, 4.0)], 10.0, 5.0),  # the one between changes nothing
        ([(170.0, 0.0, 2.0), (-170.0, 0.0, 2.0)], 180.0, 0.0),
    ],
)
def test_the_centre_of_the_bounding_box(people, pan_deg, tilt_deg):
    x, y, z = middle_of([at(*each) for each in people]).means_base_m[0]
    off = np.degrees(np.arctan2(y, x)) - pan_deg
    assert (off + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)
    assert np.degrees(np.arctan2(z, np.hypot(x, y))) == pytest.approx(tilt_deg)


@pytest.mark.parametrize(
    ("cue", "named"),
    [
        (Thinking("1.5"), "lasts_s is '1.5'"),
        (Thinking(None), "lasts_s is None"),
        (Thinking(1500), "lasts_s is 1500; accepted: seconds from 0 to 30"),
        (Speech(float("nan")), "in_s is nan"),
        (Glance(np.zeros(3), None), "lasts_s is None"),
        (Rhythm("singing"), "rhythm is 'singing'"),
        (Choice(7), "person_id is 7"),
    ],
)
def test_an_invalid_cue_is_refused(cue, named):
    cues = Cues()
    with pytest.raises(ValueError, match=re.escape(named)):
        cues.put(cue)
    assert cues.take() == []
