"""Synthetic examples for fits."""

import numpy as np

from experiments.fit.examples import Examples
from predictors.walker.features import KNOWN, N_INPUTS, N_PLACES, N_SPREAD, N_VELOCITIES
from predictors.walker.knots import KNOTS_S


def toy(n, seed):
    """Sideways departures that are a function of two sideways inputs, as a mirrored walk demands."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((n, N_INPUTS)).astype(np.float32)
    x[:, KNOWN] = rng.uniform(0.0, 1.0, (n, 2))
    y = np.zeros((n, KNOTS_S.size, 3), dtype=np.float32)
    y[..., 1] = 0.1 * KNOTS_S * np.tanh(x[:, 1:2] + 0.5 * x[:, 4:5])
    y[::5, 6:] = np.nan
    noise_m = np.zeros((n, 2, 3), dtype=np.float32)
    noise_m[np.arange(n), np.arange(n) % 2] = 0.01  # of every other tracker that states it
    nowhere, still = (np.zeros((n, size, 3), dtype=np.float32) for size in (N_PLACES, N_VELOCITIES))
    ones = np.ones(n, dtype=np.float32)
    spread = np.ones((n, N_SPREAD), dtype=np.float32)
    return Examples(x, spread, noise_m, y, ones, nowhere, still)
