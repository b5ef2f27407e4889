"""Sensor and placement: noise, latency, rate, range, robot position, and the truth between frames."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.polynomial import polyder, polyval
from scipy.spatial.transform import Rotation

from gazempc.errors import PlacementError, SettingsError
from gazempc.recordings.placement import place
from gazempc.recordings.recording import Recording, Track, TrueHead
from gazempc.recordings.synthetic.walks import generate
from gazempc.sim.sensor import default_sensor, load_sensor, observe

PERFECT = load_sensor("perfect")
REFERENCE = load_sensor("reference")


def recording(times_s, head_m, yaw=0.0, name="walk", measured=None, valid=None):
    """A walk with the head turned 0.2 rad further left than the pelvis, whose yaw is given."""
    seen = np.full(times_s.size, True) if valid is None else valid
    yaws = np.broadcast_to(np.asarray(yaw, dtype=np.float64), times_s.shape)
    track = Track(
        head_position_m=np.where(seen[:, None], head_m, np.nan),
        head_quat_wxyz=np.where(seen[:, None], quats(yaws + 0.2), np.nan),
        pelvis_position_m=np.where(seen[:, None], head_m - [0.0, 0.0, 0.7], np.nan),
        pelvis_quat_wxyz=np.where(seen[:, None], quats(yaws), np.nan),
    )
    return Recording(name, "test", "motion capture", times_s, track, measured, has_robot=True)


def quats(yaws):
    return Rotation.from_euler("z", yaws[:, None]).as_quat(scalar_first=True)


def yaw_of(quat_wxyz):
    x, y, _ = Rotation.from_quat(quat_wxyz, scalar_first=True).apply([1.0, 0.0, 0.0]).T
    return np.arctan2(y, x)


def standing(frames, rate_hz=30.0, name="walk"):
    return recording(np.arange(frames) / rate_hz, np.tile([2.0, 0.5, 0.3], (frames, 1)), name=name)


def positions(sightings):
    return np.array([each.observation.head_position_base_m for each in sightings])


def capture_times(sightings):
    return np.array([each.observation.capture_time_s for each in sightings])


# ---------------------------------------------------------------- noise


def test_noise_is_white_with_the_stated_standard_deviations():
    frames = 6000
    sightings = observe(standing(frames), REFERENCE, seed=1)
    jitter = positions(sightings) - [2.0, 0.5, 0.3]
    head = yaw_of(np.array([each.observation.head_quat_wxyz for each in sightings])) - 0.2
    pelvis = yaw_of(np.array([each.observation.pelvis_quat_wxyz for each in sightings]))
    noise = np.column_stack([jitter / 0.010, head / np.deg2rad(2.0), pelvis / np.deg2rad(2.0)])
    tolerance = 5.0 / np.sqrt(frames)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=tolerance)
    np.testing.assert_allclose(np.cov(noise.T), np.eye(5), atol=1.5 * tolerance)
    np.testing.assert_allclose(noise[1:].T @ noise[:-1] / frames, 0.0, atol=tolerance)


def test_the_noise_of_a_frame_does_not_depend_on_latency_rate_or_dropouts():
    walk = standing(240, rate_hz=120.0)
    every = REFERENCE.model_copy(update={"rate_hz": 120.0})
    all_frames = dict(zip(capture_times(observe(walk, every, 1)), positions(observe(walk, every, 1)), strict=True))
    assert len(all_frames) == 240
    for change in ({"rate_hz": 30.0}, {"rate_hz": 120.0, "dropout_probability": 0.5}, {"latency_s": 0.3}):
        sightings = observe(walk, REFERENCE.model_copy(update=change), 1)
        for time_s, position in zip(capture_times(sightings), positions(sightings), strict=True):
            np.testing.assert_array_equal(position, all_frames[time_s])


# ---------------------------------------------------------------- latency, rate, range, dropouts


@given(seed=st.integers(0, 100), rate_hz=st.sampled_from([10.0, 30.0, 50.0]))
def test_thinning_takes_the_frame_nearest_to_each_tick(seed, rate_hz):
    """With irregular time stamps."""
    times_s = np.cumsum(np.random.default_rng(seed).uniform(0.003, 0.013, 120))
    times_s -= times_s[0]
    walk = recording(times_s, np.tile([2.0, 0.5, 0.3], (120, 1)))
    ticks = np.arange(0.0, times_s[-1], 1.0 / rate_hz)
    nearest = sorted({int(np.argmin(np.abs(times_s - tick))) for tick in ticks})
    seen = observe(walk, PERFECT.model_copy(update={"rate_hz": rate_hz}), seed=1)
    np.testing.assert_array_equal(capture_times(seen), times_s[nearest])


@pytest.mark.parametrize("rate_hz", [29.97, 30.0, 31.0, 15.0])
def test_a_recording_at_or_below_the_sensor_rate_is_not_thinned(rate_hz):
    walk = standing(300, rate_hz=rate_hz)
    np.testing.assert_array_equal(capture_times(observe(walk, REFERENCE, seed=1)), walk.times_s)


def test_only_heads_in_range_are_observed():
    """Range is the 3-D distance, including the height above the sensor."""
    head = np.column_stack([np.linspace(0.5, 6.0, 100), np.zeros(100), np.full(100, 1.5)])
    walk = recording(np.arange(100) / 30.0, head)
    sensor = PERFECT.model_copy(update={"range_min_m": 2.0, "range_max_m": 4.0})
    distance = np.sqrt(head[:, 0] ** 2 + 1.5**2)
    expected = walk.times_s[(distance >= 2.0) & (distance <= 4.0)]
    np.testing.assert_array_equal(capture_times(observe(walk, sensor, seed=1)), expected)


def test_dropouts_lose_their_share_of_frames():
    walk = standing(3000)
    sensor = PERFECT.model_copy(update={"dropout_probability": 0.3})
    first = capture_times(observe(walk, sensor, seed=1))
    assert first.size / 3000 == pytest.approx(0.7, abs=5 * np.sqrt(0.21 / 3000))
    np.testing.assert_array_equal(capture_times(observe(walk, sensor, seed=1)), first)
    assert set(capture_times(observe(walk, sensor, seed=2))) != set(first)


def test_a_sensor_without_a_person_in_view_is_an_error():
    with pytest.raises(SettingsError, match=r"'perfect' never sees the person in walk: check its range"):
        observe(standing(30), PERFECT.model_copy(update={"range_max_m": 1.0}), seed=1)


@pytest.mark.parametrize("part", ["head_quat_wxyz", "pelvis_quat_wxyz"])
def test_an_unknown_orientation_is_not_observed(part):
    """Other values are unchanged, with the same noise."""
    walk, other_walk = standing(30), standing(30)
    getattr(other_walk.truth, part)[10:20] = np.nan
    pairs = zip(observe(other_walk, REFERENCE, seed=1), observe(walk, REFERENCE, seed=1), strict=True)
    for i, (other, each) in enumerate(pairs):
        expected = replace(each.observation, **{part: None}) if 10 <= i < 20 else each.observation
        for name in ("head_position_base_m", "head_quat_wxyz", "pelvis_quat_wxyz"):
            np.testing.assert_array_equal(getattr(other.observation, name), getattr(expected, name))


# ---------------------------------------------------------------- recorded


def test_recorded_sensor_replays_the_measured_track_with_its_gaps():
    valid = np.arange(30) % 5 != 0
    times_s = np.arange(30) / 30.0
    measured = recording(times_s, np.full((30, 3), 1.5), yaw=1.0, valid=valid).truth
    walk = recording(times_s, np.ones((30, 3)), measured=measured)
    sightings = observe(walk, load_sensor("recorded"), seed=1)
    np.testing.assert_array_equal(capture_times(sightings), times_s[valid])
    np.testing.assert_array_equal(positions(sightings), np.full((24, 3), 1.5))
    assert yaw_of(sightings[0].observation.pelvis_quat_wxyz) == pytest.approx(1.0)
    assert sightings[0].arrival_s == pytest.approx(times_s[1] + 0.066)


def test_recorded_sensor_refuses_a_recording_without_a_measured_track():
    with pytest.raises(SettingsError, match=r"'recorded'.*walk \(motion capture\).*reference"):
        observe(standing(30), load_sensor("recorded"), seed=1)


def test_the_default_sensor_fits_the_recording():
    assert default_sensor(standing(2)) == "reference"
    assert default_sensor(generate("subject01_R1")) == "reference"
    assert default_sensor(replace(standing(2), kind="body tracking")) == "recorded"


# ---------------------------------------------------------------- placement


def curved_walk(start_s=0.0, turns_back=False):
    times_s = start_s + np.arange(90) / 30.0
    t = np.linspace(0.0, 1.0, 90)
    if turns_back:
        t = t * (1.6 - t)
    head = np.column_stack([1.0 - 3.0 * t, 4.0 + 2.0 * t + 0.4 * np.sin(3 * t), 1.6 + 0.03 * np.sin(40 * t)])
    measured = recording(times_s, head + 0.05, yaw=2.5 + t).truth
    return recording(times_s, head, yaw=2.5 + t, measured=measured)


@pytest.mark.parametrize("turns_back", [False, True])
def test_the_side_placement_equals_its_definition(turns_back):
    """In the walk's frame: robot at c + 2.5 (z x d), 1.2 m up, x axis towards c; computed with 4 x 4 matrices."""
    walk = curved_walk(turns_back=turns_back)
    head = walk.truth.head_position_m
    c = head.mean(axis=0)
    far = max(range(90), key=lambda i: float(np.hypot(*(head[i] - head[0])[:2])))
    d = (head[far] - head[0]) * [1, 1, 0]
    d = d / np.linalg.norm(d)
    side = np.cross([0.0, 0.0, 1.0], d)
    base = np.eye(4)
    base[:3, 0] = -side  # forward: facing c
    base[:3, 1] = np.cross([0.0, 0.0, 1.0], -side)  # left
    base[:3, 3] = [*(c + 2.5 * side)[:2], 1.2]
    to_base = np.linalg.inv(base)
    placed = place(walk, "side", 2.5, 1.2)
    for mine, theirs in ((placed.truth, walk.truth), (placed.measured, walk.measured)):
        for part in ("head", "pelvis"):
            expected = getattr(theirs, f"{part}_position_m") @ to_base[:3, :3].T + to_base[:3, 3]
            np.testing.assert_allclose(getattr(mine, f"{part}_position_m"), expected, atol=1e-12)
            given, turned = (Rotation.from_quat(getattr(each, f"{part}_quat_wxyz"), scalar_first=True).as_matrix()
                             for each in (theirs, mine))  # fmt: skip
            np.testing.assert_allclose(turned, to_base[:3, :3] @ given, atol=1e-12)
    np.testing.assert_allclose(placed.truth.head_position_m.mean(axis=0), [2.5, 0.0, c[2] - 1.2], atol=1e-12)
    assert placed.has_robot


def test_a_walk_too_near_is_refused_with_the_distance():
    """A half circle of 2 m radius whose centre point is nearest to the robot."""
    angle = np.linspace(0.0, np.pi, 91)
    head = np.column_stack([2 * np.cos(angle), -2 * np.sin(angle), np.full(91, 1.6)])
    walk = recording(np.arange(91) / 30.0, head)
    bulge = 2.0 - abs(float(head[:, 1].mean()))  # d is -x, so the robot stands towards -y
    assert place(walk, "side", bulge + 0.81, 1.2).truth.head_position_m[:, 0].min() == pytest.approx(0.81)
    distance = bulge + 0.79
    with pytest.raises(PlacementError, match=r"walk: the head comes within 0\.79 m .*at least 0\.8 m") as caught:
        place(walk, "side", distance, 1.2)
    assert f"{distance} m" in str(caught.value)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_the_robot_stands_in_front_of_a_standing_person(yaw):
    """The head's forward axis points at the robot."""
    rng = np.random.default_rng(1)
    head = np.array([3.0, -2.0, 1.6]) + 0.01 * rng.standard_normal((60, 3))
    placed = place(recording(np.arange(60) / 30.0, head, yaw=yaw), "side", 1.5, 1.2)
    np.testing.assert_allclose(placed.truth.head_position_m.mean(axis=0)[:2], [1.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.abs(yaw_of(placed.truth.head_quat_wxyz)), np.pi, atol=1e-9)


# ---------------------------------------------------------------- truth between frames


# Rows are powers of time.
CUBIC = np.array([[1.0, -2.0, 0.5], [0.5, 1.0, -1.0], [0.3, -0.2, 0.1], [-0.1, 0.2, 0.05]])


def cubic(times_s, derivative=0):
    return polyval(times_s, polyder(CUBIC, derivative)).T


def test_the_truth_interpolates_a_cubic_exactly():
    times_s = np.sort(np.random.default_rng(1).uniform(0.0, 2.0, 40))
    between_s = np.linspace(times_s[0], times_s[-1], 333)
    truth = TrueHead(recording(times_s, cubic(times_s)))
    np.testing.assert_allclose(truth(between_s), cubic(between_s), atol=1e-11)


def test_beyond_the_frames_the_truth_has_constant_velocity():
    times_s = np.linspace(0.0, 2.0, 40)
    truth = TrueHead(recording(times_s, cubic(times_s)))
    ahead = np.array([0.0, 0.3, 2.0])[:, None]
    np.testing.assert_allclose(truth(2.0 + ahead[:, 0]), cubic(2.0) + ahead * cubic(2.0, 1), atol=1e-10)
    np.testing.assert_allclose(truth(-ahead[:, 0]), cubic(0.0) - ahead * cubic(0.0, 1), atol=1e-10)


def test_invalid_frames_are_bridged():
    times_s = np.linspace(0.0, 2.0, 41)
    valid = np.full(41, True)
    valid[[0, 12, 13, 14, 40]] = False
    truth = TrueHead(recording(times_s, cubic(times_s), valid=valid))
    np.testing.assert_allclose(truth(np.linspace(0.05, 1.95, 77)), cubic(np.linspace(0.05, 1.95, 77)), atol=1e-11)
    np.testing.assert_allclose(truth(np.array([2.0])), cubic(1.95) + 0.05 * cubic(1.95, 1)[None], atol=1e-10)
