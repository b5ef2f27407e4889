"""Synthetic people who stand, gesture, turn, start and stop: reproducible, in view, and moving as people do."""

import numpy as np
import pytest

from gazempc.recordings.readers.labels import travel
from gazempc.recordings.synthetic.everyday import everyday_names, generate_everyday

STANDING = ("stand", "gesture", "turn_on_spot")


@pytest.fixture(scope="module")
def people():
    return {name: generate_everyday(name) for name in everyday_names()}


def of(people, *activities):
    return [person for name, person in people.items() if name.partition("_")[2] in activities]


def speed_m_s(position_m):
    """Horizontal, over 0.3 s."""
    return np.linalg.norm(position_m[9:, :2] - position_m[:-9, :2], axis=1) / 0.3


def test_a_recording_is_the_same_on_every_platform(people):
    person = people["subject09_start"]
    found = [
        *person.truth.head_position_m[150],
        *person.truth.head_quat_wxyz[150][[0, 3]],
        *person.measured.head_position_m[150],
    ]
    expected = [2.601348424, 1.495315413, 0.480469613, 0.518714131, -0.854539961, 2.606423659, 1.495219158, 0.479096082]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8)


def test_truth_is_complete_and_people_are_in_the_sensors_view(people):
    for person in people.values():
        assert 8.0 <= person.times_s[-1] + 1 / 30 <= 10.01
        head_m, pelvis_m = person.truth.head_position_m, person.truth.pelvis_position_m
        distance_m = np.linalg.norm(head_m, axis=1)
        assert distance_m.min() > 0.9, person.name
        assert distance_m.max() < 5.4, person.name
        assert np.degrees(np.abs(np.arctan2(head_m[:, 1], head_m[:, 0]))).max() < 37.5, person.name
        assert np.linalg.norm(head_m - pelvis_m, axis=1).max() < 0.85, person.name


def test_standing_people_stay_on_the_spot(people):
    for person in of(people, *STANDING):
        assert not travel(person.times_s, person.truth.head_position_m).leaves, person.name
    for person in of(people, "start", "stop"):
        assert travel(person.times_s, person.truth.head_position_m).leaves, person.name


def test_steady_walking_is_reached_and_left_within_two_to_three_steps(people):
    """A step takes 0.5 to 0.7 s; the window of the speed adds 0.3 s."""
    for person in of(people, "start", "stop"):
        speed = speed_m_s(person.truth.pelvis_position_m)
        speed = speed if person.name.endswith("start") else speed[::-1]
        steady = np.median(speed[-60:])
        assert 0.6 < steady < 1.4
        late = np.flatnonzero(speed < 0.1 * steady)[-1]
        on = late + np.flatnonzero(speed[late:] > 0.9 * steady)[0]
        assert 0.4 < (on - late) / 30 < 2.2, person.name
        assert late / 30 > 3.0, person.name
