"""Plans on necks of all kinds: always one, and finite. Their times are figures of the benchmark."""

import numpy as np

from benchmarks.extreme_necks import count, random_neck
from gazempc.neck.spec import load_neck


def test_on_random_necks_there_is_a_finite_plan():
    rng = np.random.default_rng(1)
    counts = count([random_neck(rng) for _ in range(12)], 6, rng)
    assert counts.plans == 72
    assert counts.not_finite == 0
    assert counts.gave_up < 0.3 * counts.plans


def test_on_shipped_necks_the_solver_never_gives_up():
    rng = np.random.default_rng(2)
    counts = count([load_neck(name) for name in ("reference", "slow", "pr2", "fetch", "reachy_mini")], 12, rng)
    assert counts.gave_up == 0
