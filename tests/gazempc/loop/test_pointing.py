"""Pointing at a place: the path against its requested limits, and a run."""

import time

import numpy as np
import pytest
from builders.waiting import wait_for
from hypothesis import given
from hypothesis import strategies as st

import gazempc as gz
from gazempc.loop.pointing import Place
from gazempc.neck.kinematics import gaze_error_rad
from gazempc.people.attention import Attention
from gazempc.people.company import NOT_AT_ALL
from gazempc.people.person import PersonState
from gazempc.settings import AttentionSettings

SPEED = st.floats(0.05, 3.0)


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), SPEED, st.floats(0.0, 4.0))
def test_a_path_keeps_speed_and_duration_and_ends_at_the_point(at_m, speed_rad_s, lasts_s):
    target_m = np.array(at_m) + np.array([0.0, 0.0, 7.0])
    forward = np.array([1.0, 0.0, 0.0])
    place = Place.reached(target_m, np.zeros(3), forward, 2.0, lasts_s, speed_rad_s)
    assert place.lasts_s >= lasts_s
    times_s = 2.0 + np.linspace(-0.1, place.lasts_s + 0.1, 400)
    seen = place.at(times_s)
    ways = seen / np.linalg.norm(seen, axis=1)[:, None]
    np.testing.assert_allclose(ways[0], forward, atol=1e-9)
    np.testing.assert_allclose(seen[-1], target_m, atol=1e-9)
    step_rad = np.arctan2(np.linalg.norm(np.cross(ways[1:], ways[:-1]), axis=1), np.sum(ways[1:] * ways[:-1], axis=1))
    assert (step_rad / np.diff(times_s)).max() <= speed_rad_s


@pytest.mark.parametrize("ahead_m", [2.0, -2.0])
def test_a_path_to_a_point_ahead_or_behind_begins_at_the_gaze(ahead_m):
    forward, target_m = np.array([1.0, 0.0, 0.0]), np.array([ahead_m, 0.0, 0.0])
    seen = Place.reached(target_m, np.zeros(3), forward, 2.0, 1.0, np.inf).at(np.array([2.0, 3.0]))
    np.testing.assert_allclose(seen, [2.0 * forward, target_m], atol=1e-9)


@pytest.mark.slow
def test_a_point_has_priority_over_people_until_withdrawn():
    neck = gz.load_neck("reference")
    place_m, head_m = np.array([1.0, 0.6, -0.2]), np.array([2.0, -0.5, 0.3])
    with gz.Gaze("reference", "simulated", predictor="constant_velocity") as gaze:
        gaze.point(place_m)  # before the first observation

        def looks_at(target_m):
            gaze.see(time.time() - 0.03, head_m + 0.001 * np.sin(50.0 * time.time()))
            joints = gaze.joints
            return joints is not None and gaze_error_rad(neck.geometry, joints.position_rad, target_m) < 0.02

        for target_m, ask in ((place_m, place_m), (head_m, None), (place_m, place_m)):
            gaze.point(ask)
            wait_for(lambda target_m=target_m: looks_at(target_m), step=lambda: time.sleep(0.03))
        with pytest.raises(ValueError, match="min_duration_s"):
            gaze.point(place_m, max_velocity_rad_s=0.0)
        with pytest.raises(ValueError, match="target_base_m"):
            gaze.point([1.0, np.nan, 0.0])
    assert gz.measure(gaze.log()).limit_violations == 0


def test_a_chosen_person_has_priority_over_the_policy():
    class First:
        def reset(self):
            pass

        def scores(self, company):
            return [0.0 if person.number == 1 else NOT_AT_ALL for person in company.people]

    def person(number, name):
        return PersonState(number, name, 0.0, np.array([2.0, number - 1.5, 0.3]), np.zeros(3), None, 0.0, 0.0)

    anna, bob = person(1, "anna"), person(2, "bob")
    attention = Attention(First(), AttentionSettings())
    assert attention.update([anna, bob], 0.0).number == 1
    attention.chosen_id = "bob"
    assert attention.update([anna, bob], 0.01).number == 2
    assert attention.update([anna], 0.02).number == 1
    attention.update([anna, bob], 0.03)
    attention.chosen_id = None
    assert attention.update([anna, bob], 5.0).number == 2  # the policy's hysteresis begins
    assert attention.update([anna, bob], 9.0).number == 1
