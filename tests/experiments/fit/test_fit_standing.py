"""People on the spot: idle motion is bounded and repeatable, recorded standing people are varied and stay there."""

import numpy as np
import pytest
from builders.fits import FRAME_S, speeds

from experiments.fit.standing import idle, vary_standing
from experiments.fit.variants import GaplessWalk


def test_idle_motion_is_the_same_for_the_same_seed_and_slower_than_a_walk():
    peaks_m_s, spans_m = [], []
    for seed in range(60):
        a, b = (idle(180, FRAME_S, np.random.default_rng(seed)) for _ in range(2))
        np.testing.assert_array_equal(a.head_m, b.head_m)
        np.testing.assert_array_equal(a.head_yaw_rad, b.head_yaw_rad)
        peaks_m_s.append(np.linalg.norm(np.diff(a.head_m[:, :2], axis=0), axis=1).max() / FRAME_S)
        spans_m.append(np.ptp(a.head_m[:, :2], axis=0).max())
    assert np.median(peaks_m_s) < 0.7
    assert max(peaks_m_s) < 2.1  # three motions at once
    assert np.median(spans_m) < 0.4


@pytest.mark.parametrize("seed", range(6))
def test_a_varied_person_stays_near_where_they_stood(seed):
    """RegimeMotion about the mean is scaled by 0.4 to 1.5 and played at 0.7 to 1.35 of its pace."""
    t = np.arange(240) * FRAME_S
    head_m = np.stack([0.1 * np.sin(2 * t), 0.05 * np.cos(2 * t), 1.6 + 0.0 * t], axis=1)
    own = GaplessWalk(t, head_m, 0.5 * np.sin(t), np.sin(t))
    found = vary_standing(own, np.random.default_rng(seed))
    assert found.times_s[-1] - found.times_s[0] <= 6.0 + 1e-9
    assert 0.4 * 0.15 < np.ptp(found.head_m[:, 0]) < 1.5 * 0.21
    assert speeds(found, 0.1).max() < 1.5 * 1.35 * 0.21
    assert np.ptp(found.pelvis_yaw_rad) <= 1.0 + 1e-9
