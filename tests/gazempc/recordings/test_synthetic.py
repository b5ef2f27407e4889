"""The synthetic data set: exact reproducibility, the experiment's frame, and people who walk like people."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from gazempc.recordings.readers.labels import route_group
from gazempc.recordings.synthetic.walks import generate, synthetic_names

FRAME_S = 1.0 / 30.0


@pytest.fixture(scope="module")
def walks():
    return {name: generate(name) for name in synthetic_names()}


def route_of(walk):
    return walk.name.split("_")[1]


def on_routes(walks, *routes):
    return [walk for walk in walks.values() if route_of(walk) in routes]


def yaw_rad(quat_wxyz):
    yaw = Rotation.from_quat(quat_wxyz, scalar_first=True).as_euler("ZYX")[:, 0]
    return np.unwrap(yaw)


def travel(walk, sigma_frames=8.0):
    """Speed and direction of the pelvis with the gait smoothed away."""
    velocity = np.gradient(walk.truth.pelvis_position_m[:, :2], FRAME_S, axis=0)
    velocity = gaussian_filter1d(velocity, sigma_frames, axis=0, mode="nearest")
    return np.hypot(*velocity.T), np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))


def lead_s(early, late):
    """By how much `early` leads `late`: the peak of their cross-correlation, within 0.6 s."""
    lags = np.arange(-18, 19)
    count = len(early)
    similarity = [
        np.corrcoef(early[max(0, -lag) : count - max(0, lag)], late[max(0, lag) : count - max(0, -lag)])[0, 1]
        for lag in lags
    ]
    best = int(np.argmax(similarity))
    assert 0 < best < len(lags) - 1
    before, peak, after = similarity[best - 1 : best + 2]
    return float(lags[best] + 0.5 * (before - after) / (before - 2 * peak + after)) * FRAME_S


def test_a_recording_is_the_same_on_every_platform(walks):
    walk = walks["subject03_R5"]
    assert walk.measured is not None
    rows = [0, 70, -1]
    expected = [
        5.013262172314, 1.367599517557, 0.419692020173, 2.728130409325, 0.819224365177, 0.417529619145,
        3.257223171937, -1.300852871127, 0.405438923427, 0.279968778511, 0.055983771996, -0.004215026902,
        -0.958366075089, 0.309252247329, 0.000000000000, 0.000000000000, -0.950980045806, 2.735070327453,
        0.824824858816, 0.419059721325,
    ]  # fmt: skip
    found = np.concatenate(
        [
            walk.truth.head_position_m[rows].ravel(),
            walk.truth.head_quat_wxyz[70],
            walk.truth.pelvis_quat_wxyz[70],
            walk.measured.head_position_m[70],
        ]
    )
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)


def test_groups_follow_from_the_motion(walks):
    for walk in walks.values():
        assert route_group(walk.times_s, walk.truth.pelvis_position_m) == walk.labels.group, walk.name


def test_head_yaw_leads_the_direction_of_travel_in_sharp_turns(walks):
    leads = {}
    for subject in range(1, 15):
        of_subject = [
            lead_s(
                gaussian_filter1d(np.gradient(yaw_rad(walk.truth.head_quat_wxyz)), 8.0),
                gaussian_filter1d(np.gradient(travel(walk)[1]), 1.0),
            )
            for walk in (walks[f"subject{subject:02}_R5"], walks[f"subject{subject:02}_R6"])
        ]
        leads[subject] = np.mean(of_subject)
    assert 0.15 < np.mean(list(leads.values())) < 0.26
    assert min(leads.values()) > 0.0


def noise_m(walk):
    """Distance, error along the ray, and error across it in one direction, of frames with a person."""
    assert walk.measured is not None
    seen = walk.measured.valid
    true = walk.truth.head_position_m[seen]
    error = walk.measured.head_position_m[seen] - true
    distance = np.linalg.norm(true, axis=1)
    along = (error * true).sum(axis=1) / distance
    left = np.stack([-true[:, 1], true[:, 0]], axis=1) / np.hypot(true[:, 0], true[:, 1])[:, None]
    return distance, along, (error[:, :2] * left).sum(axis=1)


def test_position_noise_is_that_of_the_depth_camera(walks):
    parts = [noise_m(walk) for walk in walks.values()]
    biases = np.array([along.mean() for _, along, _ in parts])
    assert np.abs(biases).max() < 0.011 + 0.005  # the noise leaves about 1.4 mm in a mean over a clip
    assert biases.std() > 0.004
    distance = np.concatenate([part[0] for part in parts])
    along = np.concatenate([part[1] - part[1].mean() for part in parts])
    across = np.concatenate([part[2] for part in parts])
    far, near = distance > 3.4, distance < 2.4
    assert 0.015 < along[far].std() < 0.0175
    assert 0.005 < along[near].std() < 0.013
    assert 0.2 < across.std() / along.std() < 0.6
    assert abs(np.corrcoef(along[:-1], along[1:])[0, 1]) < 0.05
