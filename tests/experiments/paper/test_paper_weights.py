"""Tuned weights against the exact ones; who is judged is not tuned on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.paper.frames import (
    Frames,
)
from experiments.paper.validation import exact_weight, leave_one_subject_out, total_error_mm
from gazempc.errors import GazempcError


def video(base_m, turn_m, subject="a", group="R12", name="v"):
    base_m, turn_m = np.atleast_2d(base_m).astype(float), np.atleast_2d(turn_m).astype(float)
    return Frames(name, subject, group, base_m, turn_m, np.zeros(len(base_m)))


def random_videos(seed, count=3, size=40):
    rng = np.random.default_rng(seed)
    videos = []
    for k in range(count):
        turn = 0.1 * rng.standard_normal((size, 3))
        # Optima on either side of the bounds and between them.
        base = -rng.uniform(-0.5, 1.5) * turn + 0.05 * rng.standard_normal((size, 3))
        videos.append(video(base, turn, subject=f"s{k}", name=f"v{k}"))
    return videos


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_the_exact_weight_is_the_least_on_a_fine_grid(seed):
    videos = random_videos(seed, count=1)
    base, turn = videos[0].base_m, videos[0].turn_m
    grid = np.linspace(0, 1, 2001)
    totals = [1e3 * np.sqrt(((base + w * turn) ** 2).sum(axis=1)).sum() for w in grid]
    weight = exact_weight(videos)
    assert 0 <= weight <= 1
    assert total_error_mm(videos, weight) <= min(totals) * (1 + 1e-9)
    assert abs(weight - grid[np.argmin(totals)]) <= 1.01 / 2000


def test_who_is_judged_is_not_tuned_on():
    """Only c's frames ask for w = 1, and they outweigh the others', who ask for 0; c has two videos."""
    turn = np.tile([0.1, 0.0, 0.0], (20, 1))
    videos = [
        video(-10 * turn, 10 * turn, "c", name="c1"),
        video(0 * turn, turn, "a", name="a1"),
        video(0 * turn, turn, "b", "R34", name="b1"),
        video(-10 * turn, 10 * turn, "c", "R34", name="c2"),
    ]
    judged = leave_one_subject_out(videos, 0, 30)
    assert [(j.recording, j.subject, j.group) for j in judged] == [(v.recording, v.subject, v.group) for v in videos]
    weights = {j.recording: j.weight for j in judged}
    assert weights["c1"] == weights["c2"] < 0.1
    assert min(weights["a1"], weights["b1"]) > 0.9
    for j, v in zip(judged, videos, strict=True):
        np.testing.assert_array_equal(j.baseline_mm, v.error_mm(0.0))
        np.testing.assert_allclose(j.proposed_mm, 1e3 * np.abs(v.base_m + j.weight * v.turn_m)[:, 0])
    shuffled = {j.recording: j.weight for j in leave_one_subject_out(videos, 0, 30)}
    assert shuffled == weights


def test_one_subject_cannot_be_left_out():
    with pytest.raises(GazempcError, match="at least 2 subjects"):
        leave_one_subject_out(random_videos(0, count=1), 0, 5)
