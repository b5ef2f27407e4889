"""Variants of walks on which the predictor `walker` is fitted: what they change, and what they leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.fit.variants import GaplessWalk, bend, glance, walk_of
from gazempc.errors import GazempcError
from gazempc.recordings.load import load


@pytest.fixture
def walk():
    return walk_of(load("subject03_R1"))


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def steps_m(walk):
    return np.linalg.norm(np.diff(walk.head_m[:, :2], axis=0), axis=1)


def test_a_bent_walk_has_the_same_heights_and_no_longer_steps(walk, rng):
    for _ in range(20):
        bent = bend(walk, rng)
        np.testing.assert_array_equal(bent.head_m[:, 2], walk.head_m[:, 2])
        ratio = steps_m(bent) / steps_m(walk)
        assert np.all(ratio <= 1.0 + 1e-9)
        assert np.all(ratio >= 0.55 - 1e-9)


def test_pelvis_head_and_path_turn_by_the_same_angle(walk):
    """Bent long before its end, body and path have turned alike: what is left between them is gait and offset."""
    longer = GaplessWalk(
        np.linspace(0.0, 12.0, 361),
        np.column_stack([np.linspace(0.0, 14.0, 361), np.zeros(361), np.full(361, 1.5)]),
        np.zeros(361),
        np.zeros(361),
    )
    turned = []
    for seed in range(40):
        bent = bend(longer, np.random.default_rng(seed))
        step = np.diff(bent.head_m[-2:, :2], axis=0)[0]
        path = np.arctan2(step[1], step[0])
        if abs(np.ptp(bent.pelvis_yaw_rad[-20:])) < 1e-6 and abs(np.ptp(bent.head_yaw_rad[-20:])) < 1e-6:
            turned.append(abs(bent.pelvis_yaw_rad[-1]))
            for yaw in (bent.pelvis_yaw_rad[-1], bent.head_yaw_rad[-1]):
                assert np.cos(yaw - path) > np.cos(np.radians(12.0))
    assert np.degrees(np.mean(turned)) > 30


def test_a_glance_turns_nothing_but_the_head(walk, rng):
    looking = glance(walk, rng, 40.0)
    np.testing.assert_array_equal(looking.head_m, walk.head_m)
    np.testing.assert_array_equal(looking.pelvis_yaw_rad, walk.pelvis_yaw_rad)
    away = np.abs(np.degrees(looking.head_yaw_rad - walk.head_yaw_rad))
    assert away.max() == pytest.approx(40.0, abs=1.0) or away.max() < 40.0


def test_a_walk_is_the_longest_stretch_without_a_gap():
    recording = load("subject01_R1")
    valid = np.ones(recording.times_s.size, dtype=bool)
    valid[30:45] = valid[100] = False
    holed = replace(recording, truth=replace(recording.truth, valid=valid))
    times_s = walk_of(holed).times_s
    assert times_s[0] == recording.times_s[45]
    assert recording.times_s[100] not in times_s
    assert times_s[-1] == recording.times_s[-1]
    valid[:] = False
    valid[:20] = True
    with pytest.raises(GazempcError, match=r"0\.63 s; to fit on it, at least 1\.25 s"):
        walk_of(replace(recording, truth=replace(recording.truth, valid=valid)))


@pytest.mark.parametrize("part", ["head", "pelvis"])
def test_a_walk_without_orientations_is_refused(part):
    recording = load("subject01_R1")
    name = f"{part}_quat_wxyz"
    unknown = replace(recording.truth, **{name: np.full((recording.times_s.size, 4), np.nan)})
    with pytest.raises(GazempcError, match=f"subject01_R1: the orientation of the {part} is not known"):
        walk_of(replace(recording, truth=unknown))
