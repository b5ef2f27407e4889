"""The sensor's latency: found, or refused where the data do not determine it."""

import numpy as np
import pytest

from gazempc.identify.latency import estimate_latency
from gazempc.identify.record import IdentificationError


def walk(times_s):
    return np.stack([2.0 + 0.3 * np.sin(times_s), 1.3 * times_s - 3.0, 0.03 * np.sin(11 * times_s)], axis=-1)


@pytest.mark.parametrize("latency_s", [0.066, -0.05])
def test_latency_of_a_known_motion_is_found(latency_s):
    rng, known_s, seen_s = np.random.default_rng(1), np.arange(0, 6, 0.01), np.arange(0.0, 6.0, 1 / 30)
    observed = walk(seen_s - latency_s) + np.array([0.02, -0.05, 0.0]) + rng.normal(0, 0.01, (seen_s.size, 3))
    found = estimate_latency(known_s, walk(known_s), seen_s, observed)
    assert found.value == pytest.approx(latency_s, abs=0.005)
    assert found.low <= latency_s <= found.high


def test_data_that_do_not_determine_the_latency_are_refused():
    rng, known_s, seen_s = np.random.default_rng(1), np.arange(0, 6, 0.01), np.arange(0.0, 6.0, 1 / 30)
    noise = rng.normal(0, 0.01, (seen_s.size, 3))
    with pytest.raises(IdentificationError, match="sensor latency: "):
        estimate_latency(known_s, 0.001 * walk(known_s), seen_s, 0.001 * walk(seen_s) + noise)
    with pytest.raises(IdentificationError, match="10 observations"):
        estimate_latency(known_s, walk(known_s), seen_s[:10], walk(seen_s[:10]))
    with pytest.raises(IdentificationError, match="on one clock"):
        estimate_latency(known_s, walk(known_s), seen_s, walk(seen_s - 1.4))
    with pytest.raises(IdentificationError, match="0 times"):
        estimate_latency(known_s, np.full((600, 3), np.nan), seen_s, walk(seen_s))
