"""Tests over frames and over people, against sums by hand and enumerations."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.stats import norm, wilcoxon

from experiments.paper.validation import Judged, frame_test, person_test


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


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000))
def test_the_test_over_frames_is_the_rank_sum_by_hand(seed):
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
    assert (test.n_frames, test.n_used, test.statistic) == (baseline.size, n, statistic)
    assert test.p_value == pytest.approx(p_value, rel=1e-9)
    thinned = [np.concatenate([(j.baseline_mm - j.proposed_mm)[first::15] for j in judged]) for first in range(15)]
    assert test.p_value_thinned == pytest.approx(np.median([by_hand(few)[2] for few in thinned]), rel=1e-9)
    library = wilcoxon(baseline, proposed, zero_method="wilcox", alternative="greater", method="approx")
    assert (test.statistic, test.p_value) == (library.statistic, library.pvalue)


def enumerated(gains):
    """p values better, worse and either way, over all signs that the people's gains could have had."""
    gains = np.array([g for g in gains if g])
    size = np.abs(gains)
    ranks = np.array([(size < s).sum() + ((size == s).sum() + 1) / 2 for s in size])
    sums = np.array(
        [ranks[np.array(signs, dtype=bool)].sum() for signs in itertools.product((0, 1), repeat=len(gains))]
    )
    statistic = ranks[gains > 0].sum()
    better, worse = np.mean(sums >= statistic - 1e-9), np.mean(sums <= statistic + 1e-9)
    return statistic, better, worse, min(1.0, 2 * min(better, worse))


@settings(max_examples=15)
@given(
    gains=st.lists(st.floats(-50, 50).filter(lambda g: abs(g) > 0.01), min_size=2, max_size=8), seed=st.integers(0, 99)
)
def test_the_test_over_people_is_exact(gains, seed):
    sizes = np.sort(np.abs(gains))
    assume(np.diff(sizes).min() > 1e-6)
    judged = judged_of(gains, seed)
    test = person_test(judged)
    statistic, better, worse, either = enumerated(gains)
    assert test.n_people == len(gains)
    assert test.statistic == statistic
    assert test.p_better == pytest.approx(better)
    assert test.p_worse == pytest.approx(worse)
    assert test.p_two_sided == pytest.approx(either)
    assert test.smallest_p == pytest.approx(enumerated(np.arange(1, len(gains) + 1))[1])
    assert test.difference_mm == pytest.approx(-np.mean(gains), abs=1e-9)
    total = len(gains) * (len(gains) + 1) / 2
    assert test.effect == pytest.approx((2 * statistic - total) / total)
    other = person_test(swapped(judged))
    assert other.effect == pytest.approx(-test.effect)
    assert other.difference_mm == pytest.approx(-test.difference_mm)
    assert (other.p_better, other.p_worse) == pytest.approx((test.p_worse, test.p_better))


@settings(max_examples=6)
@given(gains=st.lists(st.floats(-50, 50), min_size=5, max_size=10))
def test_intervals_contain_the_mean_and_order_does_not_matter(gains):
    assume(np.ptp(gains) > 1e-3)
    assume(np.ptp(np.abs(gains)) > 1e-3)
    judged = judged_of(gains)
    test = person_test(judged)
    low, high = test.difference_ci95_mm
    assert low <= test.difference_mm <= high
    assert -1 <= test.effect_ci95[0] <= test.effect_ci95[1] <= 1
    turned_round = judged[::-1]
    backwards, over_frames = person_test(turned_round), frame_test(turned_round)
    assert backwards.difference_ci95_mm == pytest.approx(test.difference_ci95_mm, abs=1e-9)
    assert backwards.effect == pytest.approx(test.effect)
    assert backwards.p_better == pytest.approx(test.p_better, nan_ok=True)
    assert over_frames.p_value == pytest.approx(frame_test(judged).p_value)
    assert over_frames.p_value_thinned == pytest.approx(frame_test(judged).p_value_thinned)
