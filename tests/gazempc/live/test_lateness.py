"""Lateness: percentiles from bins, against those of numpy."""

import numpy as np
import pytest

from gazempc.live.run_report import Lateness


@pytest.mark.parametrize("seed", range(5))
def test_percentiles_of_lateness_are_numpy_s_within_a_bin(seed):
    rng = np.random.default_rng(seed)
    values = rng.gamma(0.5, 2.0, size=int(rng.integers(1, 5000)))
    values[rng.random(values.size) < 0.2] *= -0.1
    lateness = Lateness()
    for value in values:
        lateness.add(float(value))
    assert lateness.count == values.size
    assert lateness.max_ms == max(values.max(), 0.0)
    clipped = np.maximum(values, 0.0)
    for percent in (0, 1, 25, 50, 90, 99, 99.9, 100):
        exact = float(np.percentile(clipped, percent, method="inverted_cdf"))
        found = lateness.percentile_ms(percent)
        assert -1e-9 <= found - exact <= 0.01 + 1e-9
    for limit_ms in (0.1, 1.0, 5.0, 150.0):
        expected = np.sum(clipped >= limit_ms)
        near = np.sum(np.abs(clipped - limit_ms) <= 0.011)
        assert abs(lateness.beyond(limit_ms) - expected) <= near
