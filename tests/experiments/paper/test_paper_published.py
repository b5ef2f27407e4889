"""What the paper prints: how many frames its statistics imply."""

import numpy as np
import pytest
from scipy.stats import norm

from experiments.paper.published import PUBLISHED, implied_frames, rank_biserial


def printed_p(statistic, n, digits):
    """One-tailed p value of a signed-rank sum by the normal approximation, as printed."""
    mean, variance = n * (n + 1) / 4, n * (n + 1) * (2 * n + 1) / 24
    return f"{norm.sf((statistic - mean) / np.sqrt(variance)):.{digits - 1}e}"


def test_the_printed_statistics_imply_2808_and_2734_frames_and_at_least_1582():
    implied = {p.group: implied_frames(p) for p in PUBLISHED}
    assert (implied["R34"].fewest, implied["R34"].most) == (2808, 2808)
    assert (implied["R56"].fewest, implied["R56"].most) == (2734, 2734)
    assert (implied["R12"].fewest, implied["R12"].most) == (1582, None)
    assert implied["R34"].thinned_p_value == pytest.approx(6.8e-8, rel=0.01)
    assert implied["R56"].thinned_p_value == pytest.approx(0.22, abs=0.005)
    assert np.isnan(implied["R12"].thinned_p_value)
    assert implied["R34"].per_video == pytest.approx(2808 / 28)
    assert implied["R12"].per_video == pytest.approx(1582 / 28)
    for p in PUBLISHED[1:]:  # the numbers beside do not round to the printed p value
        fits = {n for n in range(2600, 3000) if printed_p(p.statistic, n, 3) == f"{p.p_value:.2e}"}
        assert fits == {implied[p.group].fewest}


def test_the_published_test_of_straight_routes_asked_the_other_way_round():
    """Half of the possible rank sums lie above the printed one: the baseline errs less."""
    straight = implied_frames(PUBLISHED[0])
    assert straight.worse_p_value == pytest.approx(0.0048, abs=1e-4)
    assert straight.effect[1] < straight.effect[0] < 0
    for n in (10, 57):
        total = n * (n + 1) / 2
        assert rank_biserial(total, n) == pytest.approx(1.0)
        assert rank_biserial(0.0, n) == -1.0
        assert rank_biserial(total / 2, n) == pytest.approx(0.0)
