"""Tests over frames and over people, compared with rank sums by hand and enumeration; tuned and exact weights."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from experiments.paper.frames import Frames
from experiments.paper.validation import (
    Judged,
    exact_weight,
    frame_test,
    leave_one_subject_out,
    person_test,
)
from gazempc.errors import GazempcError


def judged_of(gains_mm_by_person, seed=0, videos=2):
    """Videos whose frames' gains (baseline - proposed) have the given means for each person."""
    rng = np.random.default_rng(seed)
    judged = []
    for k, gain in enumerate(gains_mm_by_person):
        sizes = [int(n) for n in rng.integers(5, 40, videos)]
        noise = rng.standard_normal(sum(sizes))
        gains = gain + 0.1 * (noise - noise.mean())
        proposed = rng.uniform(50, 100, sum(sizes))
        cuts = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
        for i, own in enumerate(cuts):
            judged.append(Judged(f"p{k}v{i}", f"p{k}", "R34", 0.5, (proposed + gains)[own], proposed[own]))
    return judged


def swapped(judged):
    return [dataclasses.replace(j, baseline_mm=j.proposed_mm, proposed_mm=j.baseline_mm) for j in judged]


@settings(max_examples=8)
@given(seed=st.integers(0, 10_000))
def test_the_frame_test_is_the_signed_rank_sum_by_hand(seed):
    rng = np.random.default_rng(seed)
    judged = []
    for k, size in enumerate(rng.integers(16, 60, 3)):
        baseline = rng.uniform(50, 150, size)
        proposed = baseline + rng.normal(-2.0, 10.0, size)
        proposed[rng.random(size) < 0.1] = np.nan
        proposed = np.where(np.isnan(proposed), baseline, proposed)  # frames without a difference
        judged.append(Judged(f"v{k}", f"p{k}", "R34", 0.5, baseline, proposed))
    baseline, proposed = (np.concatenate([getattr(j, n) for j in judged]) for n in ("baseline_mm", "proposed_mm"))
    test = frame_test(judged)

    def by_hand(differences):
        differences = differences[differences != 0]
        n = differences.size
        order = np.argsort(np.abs(differences))
        statistic = sum(rank + 1 for rank, i in enumerate(order) if differences[i] > 0)
        z = (statistic - n * (n + 1) / 4) / np.sqrt(n * (n + 1) * (2 * n + 1) / 24)
        return n, statistic, norm.sf(z)

    n, statistic, p_value = by_hand(baseline - proposed)
    assert (test["n_frames"], test["n_used"], test["statistic"]) == (baseline.size, n, statistic)
    assert test["p_value"] == pytest.approx(p_value, rel=1e-9)
    thinned = [np.concatenate([(j.baseline_mm - j.proposed_mm)[first::15] for j in judged]) for first in range(15)]
    assert test["p_value_thinned"] == pytest.approx(np.median([by_hand(few)[2] for few in thinned]), rel=1e-9)


def enumerated(gains):
    """p values better, worse and two-sided, over all sign patterns of the people's gains."""
    gains = np.array([g for g in gains if g])
    size = np.abs(gains)
    ranks = np.array([(size < s).sum() + ((size == s).sum() + 1) / 2 for s in size])
    sums = np.array(
        [ranks[np.array(signs, dtype=bool)].sum() for signs in itertools.product((0, 1), repeat=len(gains))]
    )
    statistic = ranks[gains > 0].sum()
    better, worse = np.mean(sums >= statistic - 1e-9), np.mean(sums <= statistic + 1e-9)
    return statistic, better, worse, min(1.0, 2 * min(better, worse))


@settings(max_examples=8)
@given(
    gains=st.lists(st.floats(-50, 50).filter(lambda g: abs(g) > 0.01), min_size=2, max_size=8), seed=st.integers(0, 99)
)
def test_the_test_over_people_enumerates_all_signs(gains, seed):
    sizes = np.sort(np.abs(gains))
    assume(np.diff(sizes).min() > 1e-6)
    judged = judged_of(gains, seed)
    test = person_test(judged)
    statistic, better, worse, either = enumerated(gains)
    assert test["n_people"] == len(gains)
    assert test["statistic"] == statistic
    assert test["p_better"] == pytest.approx(better)
    assert test["p_worse"] == pytest.approx(worse)
    assert test["p_two_sided"] == pytest.approx(either)
    assert test["smallest_p"] == pytest.approx(enumerated(np.arange(1, len(gains) + 1))[1])
    assert test["difference_mm"] == pytest.approx(-np.mean(gains), abs=1e-9)
    total = len(gains) * (len(gains) + 1) / 2
    assert test["effect"] == pytest.approx((2 * statistic - total) / total)
    if len(gains) >= 5:
        low, high = test["difference_ci95_mm"]
        assert low <= test["difference_mm"] <= high
        assert -1 <= test["effect_ci95"][0] <= test["effect_ci95"][1] <= 1
    other = person_test(swapped(judged))
    assert other["effect"] == pytest.approx(-test["effect"])
    assert other["difference_mm"] == pytest.approx(-test["difference_mm"])
    assert (other["p_better"], other["p_worse"]) == pytest.approx((test["p_worse"], test["p_better"]))


def video(base_m, turn_m, subject="a", group="R12", name="v"):
    base_m, turn_m = np.atleast_2d(base_m).astype(float), np.atleast_2d(turn_m).astype(float)
    return Frames(name, subject, group, base_m, turn_m, np.zeros(len(base_m)))


def random_videos(seed, count=3, size=40):
    rng = np.random.default_rng(seed)
    videos = []
    for k in range(count):
        turn = 0.1 * rng.standard_normal((size, 3))
        # Optima below, between and above the bounds.
        base = -rng.uniform(-0.5, 1.5) * turn + 0.05 * rng.standard_normal((size, 3))
        videos.append(video(base, turn, subject=f"s{k}", name=f"v{k}"))
    return videos


@settings(max_examples=8)
@given(seed=st.integers(0, 10_000))
def test_the_exact_weight_minimises_a_fine_grid(seed):
    videos = random_videos(seed, count=1)
    base, turn = videos[0].base_m, videos[0].turn_m
    grid = np.linspace(0, 1, 2001)
    totals = [1e3 * np.sqrt(((base + w * turn) ** 2).sum(axis=1)).sum() for w in grid]
    weight = exact_weight(videos)
    assert 0 <= weight <= 1
    assert videos[0].error_mm(weight).sum() <= min(totals) * (1 + 1e-9)
    assert abs(weight - grid[np.argmin(totals)]) <= 1.01 / 2000


def test_weights_are_tuned_without_the_tested_person():
    """Only c's frames, the majority, have the optimum w = 1; the others have 0; c has two videos."""
    turn = np.tile([0.1, 0.0, 0.0], (20, 1))
    videos = [
        video(-10 * turn, 10 * turn, "c", name="c1"),
        video(0 * turn, turn, "a", name="a1"),
        video(0 * turn, turn, "b", "R34", name="b1"),
        video(-10 * turn, 10 * turn, "c", "R34", name="c2"),
    ]
    judged = leave_one_subject_out(videos, 0, 15)
    assert [(j.recording, j.subject, j.group) for j in judged] == [(v.recording, v.subject, v.group) for v in videos]
    weights = {j.recording: j.weight for j in judged}
    assert weights["c1"] == weights["c2"] < 0.1
    assert min(weights["a1"], weights["b1"]) > 0.9
    for j, v in zip(judged, videos, strict=True):
        np.testing.assert_array_equal(j.baseline_mm, v.error_mm(0.0))
        np.testing.assert_allclose(j.proposed_mm, 1e3 * np.abs(v.base_m + j.weight * v.turn_m)[:, 0])


def test_leave_one_out_requires_two_subjects():
    with pytest.raises(GazempcError, match="at least 2 subjects"):
        leave_one_subject_out(random_videos(0, count=1), 0, 5)
