"""Synthetic people who stand, gesture, turn, start and stop: reproducible, in view, with human kinematics."""

import csv

import numpy as np
import pytest

from gazempc.recordings.load import load
from gazempc.recordings.readers.labels import travel
from gazempc.recordings.synthetic.everyday import everyday_names, generate_everyday

STANDING = ("stand", "gesture", "turn_on_spot")


@pytest.fixture(scope="module")
def people():
    return {name: generate_everyday(name) for name in everyday_names()}


def of(people, *activities):
    return [person for name, person in people.items() if name.partition("_")[2] in activities]


def speed_m_s(position_m):
    """Horizontal speed over 0.3 s."""
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


def test_the_truth_is_complete_and_people_are_in_view(people):
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


def test_walking_speed_is_reached_and_left_within_3_steps(people):
    """A step takes 0.5 to 0.7 s; the speed window adds 0.3 s."""
    for person in of(people, "start", "stop"):
        speed = speed_m_s(person.truth.pelvis_position_m)
        speed = speed if person.name.endswith("start") else speed[::-1]
        steady = np.median(speed[-60:])
        assert 0.6 < steady < 1.4
        late = np.flatnonzero(speed < 0.1 * steady)[-1]
        on = late + np.flatnonzero(speed[late:] > 0.9 * steady)[0]
        assert 0.4 < (on - late) / 30 < 2.2, person.name
        assert late / 30 > 3.0, person.name


# ---------------------------------------------------------------- whether people leave the spot, and when


def along_x(x_m, rate_hz=30.0):
    t = np.arange(x_m.size) / rate_hz
    return t, np.column_stack([x_m, np.full_like(x_m, 0.4), np.full_like(x_m, 1.6)])


def starting(rate_hz=30.0, at_s=2.0, acceleration=1.0, seconds=6.0):
    """At rest, then constant acceleration up to 1.2 m/s."""
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    ramp_s = np.clip(t - at_s, 0.0, 1.2 / acceleration)
    return along_x(0.5 * acceleration * ramp_s**2 + 1.2 * np.maximum(t - at_s - 1.2 / acceleration, 0.0), rate_hz)


@pytest.mark.parametrize("rate_hz", [5.0, 15.0, 30.0, 200.0])
def test_the_start_is_where_the_speed_passes_0_3_m_s(rate_hz):
    found = travel(*starting(rate_hz))
    assert found.leaves
    # At a low rate the resolution is one frame.
    assert found.start_s == pytest.approx(2.3, abs=max(1 / 30, 0.5 / rate_hz) + 1e-9)


@pytest.mark.parametrize(("pause_s", "starts"), [(0.3, False), (0.9, True)])
def test_a_start_follows_half_a_second_at_rest(pause_s, starts):
    t = np.arange(0.0, 6.0, 1.0 / 30.0)
    found = travel(*along_x(1.2 * np.minimum(t, 2.0) + 1.2 * np.maximum(t - 2.0 - pause_s, 0.0)))
    assert found.leaves
    # The window of the speed, 0.3 s, blurs both ends.
    assert (found.start_s == pytest.approx(2.0 + pause_s, abs=0.15)) if starts else np.isnan(found.start_s)


def test_tracker_jumps_are_not_starts():
    t = np.arange(400) / 50.0
    found = travel(*along_x(0.1 * (np.arange(t.size) % 40 > 20), 50.0))
    assert not found.leaves


def test_real_standing_and_walking_people_are_classified(walks_dir, tracks_dir):
    standing = (walks_dir.parent / "standing").glob("stand_*.csv")
    for path in [*standing, *sorted(tracks_dir.glob("vru_waiting*"))[::9]]:
        walk = load(path)
        assert not travel(walk.times_s, walk.truth.head_position_m).leaves, path.stem
        assert walk.labels.group == "standing"
    for path in sorted(walks_dir.glob("cmu*.csv"))[::4]:
        walk = load(path)
        assert travel(walk.times_s, walk.truth.head_position_m).leaves, path.stem


def test_starts_of_real_pedestrians_are_about_3_s_into_their_track(tracks_dir):
    """The data set's tracks begin 3 s before the annotated start; some people walk at the beginning as well."""
    with (tracks_dir / "index.csv").open(encoding="utf-8") as stream:
        clips = [row["clip"] for row in csv.DictReader(stream) if row["kind"] == "starting"]
    walks = [load(tracks_dir / f"{clip}.csv") for clip in clips[::6]]
    starts_s = [travel(walk.times_s, walk.truth.head_position_m).start_s - walk.times_s[0] for walk in walks]
    assert np.isfinite(starts_s).mean() > 0.9
    assert 3.0 < np.nanmedian(starts_s) < 3.4
