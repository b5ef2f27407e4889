"""Examples for fits that need no walk, and walks for fits that need no recording."""

import numpy as np

from experiments.fit.examples import Examples
from experiments.fit.variants import GaplessWalk
from predictors.walker.features import N_INPUTS, N_SPREAD
from predictors.walker.memories import N_PLACES
from predictors.walker.network import KNOTS_S

FRAME_S = 1.0 / 30.0


def toy(n, seed):
    """Sideways departures that are a function of two sideways inputs, as a mirrored walk demands."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((n, N_INPUTS)).astype(np.float32)
    y = np.zeros((n, KNOTS_S.size, 3), dtype=np.float32)
    y[..., 1] = 0.1 * KNOTS_S * np.tanh(x[:, 1:2] + 0.5 * x[:, 4:5])
    y[::5, 6:] = np.nan
    noise_m = np.zeros((n, 2, 3), dtype=np.float32)
    noise_m[np.arange(n), np.arange(n) % 2] = 0.01  # of every other tracker that states it
    still, nowhere = np.zeros((n, 3), dtype=np.float32), np.zeros((n, N_PLACES, 3), dtype=np.float32)
    ones = np.ones(n, dtype=np.float32)
    return Examples(x, np.ones((n, N_SPREAD), dtype=np.float32), noise_m, y, ones, still, nowhere)


def straight_walk(seconds=4.0, speed_m_s=1.2, heading_rad=0.4, sway_m=0.02):
    """A steady walk with a sway of one stride a second and a bob of two."""
    t = np.arange(round(seconds / FRAME_S) + 1) * FRAME_S
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    across = sway_m * np.sin(2 * np.pi * 0.95 * t)
    head = np.stack(
        [
            1.0 + speed_m_s * t * c - across * s,
            -2.0 + speed_m_s * t * s + across * c,
            1.6 + 0.02 * np.sin(2 * np.pi * 1.9 * t),
        ],
        axis=1,
    )
    turning = 0.05 * np.sin(2 * np.pi * 0.95 * t + 0.5)
    return GaplessWalk(t, head, heading_rad + 0.1 + turning, heading_rad - 0.05 + 0.5 * turning)


def standing(seconds=3.0, at_m=(2.0, 0.0, 1.6)):
    """Somebody who does not move at all."""
    n = round(seconds / FRAME_S)
    return GaplessWalk(np.arange(n) * FRAME_S, np.tile(at_m, (n, 1)), np.zeros(n), np.zeros(n))


def speeds(walk, over_s=1.05):
    """Horizontal speed over a stride, along the walk."""
    step_s = float(np.median(np.diff(walk.times_s)))
    k = min(round(over_s / step_s), walk.times_s.size - 1)
    return np.linalg.norm(walk.head_m[k:, :2] - walk.head_m[:-k, :2], axis=1) / (k * step_s)
