"""What the paper prints: how many frames its statistics imply."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from experiments.paper.published import PUBLISHED, PublishedGroup, implied_frames, rank_biserial


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


@settings(max_examples=25)
@given(n=st.integers(30, 300), z=st.floats(-3.0, 6.0), digits=st.integers(2, 4))
def test_the_number_of_frames_is_found_again(n, z, digits):
    total = n * (n + 1) // 2
    statistic = round(n * (n + 1) / 4 + z * np.sqrt(n * (n + 1) * (2 * n + 1) / 24))
    assume(0 <= statistic <= total)
    text = printed_p(statistic, n, digits)
    found = implied_frames(PublishedGroup("G", "g", 1.0, 1.0, statistic, float(text), digits), most=2 * n)
    assert found.fewest <= n <= (found.most or 2 * n)
    assert printed_p(statistic, found.fewest, digits) == text
    assert found.fewest * (found.fewest + 1) / 2 >= statistic
    if found.most is not None:
        assert printed_p(statistic, found.most, digits) == text
        assert printed_p(statistic, found.most + 1, digits) != text


def test_a_p_value_that_no_number_of_frames_has_is_refused():
    # The statistic is more than half of all ranks for any number of frames up to 20: p > 0.5 cannot be.
    with pytest.raises(ValueError, match="no number of frames up to 20"):
        implied_frames(PublishedGroup("G", "g", 1.0, 1.0, 190.0, 0.9, 2), most=20)
    # Nine ranks sum to 45 at most, so that they cannot have the p value that the formula gives for 55.
    with pytest.raises(ValueError, match="no number of frames"):
        implied_frames(PublishedGroup("G", "g", 1.0, 1.0, 55.0, float(printed_p(55, 9, 3)), 3), most=50)


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
