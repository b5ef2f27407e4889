"""Variants of recorded standing people stay near their place."""

import numpy as np
import pytest
from builders.fits import FRAME_S, speeds

from experiments.fit.standing import vary_standing
from experiments.fit.variants import GaplessWalk


@pytest.mark.parametrize("seed", range(3))
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
