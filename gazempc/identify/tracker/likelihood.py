"""Likelihood of a track with white error and wander.

Each axis by itself is position and velocity driven by white acceleration (the person), plus an Ornstein-Uhlenbeck
process (the tracker's wander), plus white noise. A Kalman filter gives the likelihood at the true times of the frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gazempc.types import BoolArray, FloatArray

# Initial variance of the position in each stretch: (1 rad)^2, or the square of a share of 1; and initial speed.
_START_VARIANCE = 1.0
_START_SPEED_M_S = 1.0
# After a longer gap, position and velocity have their initial variance again.
_RESTART_S = 1.0


@dataclass(frozen=True)
class Stretches:
    """Pieces of a track, padded to one length.

    Attributes:
        intervals_s: Time since the frame before, shape (F, B), seconds; 0 in the first frame and in the padding.
        values: Measured values on each axis, shape (F, A, B).
        used: Frames that count, shape (F, B); False in the padding and in frames that are left out.
        scales_m: Metres of one unit of `values`, shape (B,).
    """

    intervals_s: FloatArray
    values: FloatArray
    used: BoolArray
    scales_m: FloatArray

    @property
    def duration_s(self) -> float:
        """Sum of the intervals of all frames that count."""
        return float(self.intervals_s[self.used].sum())


def likelihood(data: Stretches, parameters: FloatArray, gate: float = np.inf) -> tuple[FloatArray, FloatArray]:
    """Filter all stretches with all trials at once.

    After a second without a frame that was used, the filter starts anew at the next one.

    Args:
        data: F frames of B stretches on A axes.
        parameters: Of G trials: acceleration, white error, wander and correlation time, shape (G, 4, A).
        gate: A frame whose innovation is larger than so many standard deviations on any axis is not used.

    Returns:
        Log-likelihood of each trial, axis and stretch, shape (G, A, B); and innovation over its standard deviation of
        the last trial, shape (F, A, B), NaN in frames that do not count.
    """
    frames, axes, count = data.values.shape
    shape = (len(parameters), axes, count)
    acceleration, white, wander, correlation_s = np.moveaxis(parameters, 1, 0)[..., None]
    q, r, w2 = (acceleration / data.scales_m) ** 2, white**2, wander**2
    steps_s = data.intervals_s[:, None, None, :]
    decays = np.exp(-steps_s / correlation_s)
    # Process noise depends on the intervals only: one array operation for all frames.
    noise = np.zeros((frames, 3, 3, *shape))
    noise[:, 0, 0], noise[:, 1, 1], noise[:, 2, 2] = q * steps_s**3 / 3.0, q * steps_s, w2 * (1.0 - decays**2)
    noise[:, 0, 1] = noise[:, 1, 0] = q * steps_s**2 / 2.0
    # State: position, velocity and wander, shape (3, G, A, B), and its covariance, shape (3, 3, G, A, B).
    x, p = np.zeros((3, *shape)), np.zeros((3, 3, *shape))
    start_p = np.zeros((2, 2, *shape))
    start_p[0, 0], start_p[1, 1] = _START_VARIANCE, (_START_SPEED_M_S / data.scales_m) ** 2
    x[0], p[:2, :2], p[2, 2] = data.values[0], start_p, w2
    innovations, variances = np.zeros((frames, *shape)), np.ones((frames, *shape))
    uses = np.zeros((frames, count), dtype=bool)
    unseen_s = np.zeros(count)
    for k in range(frames):
        dt, decay = data.intervals_s[k], decays[k]
        unseen_s = unseen_s + dt
        x[0] += dt * x[1]
        x[2] *= decay
        p[0] += dt * p[1]
        p[:, 0] += dt * p[:, 1]
        p[2] *= decay
        p[:, 2] *= decay
        p += noise[k]
        lost = unseen_s > _RESTART_S
        if lost.any():
            x[0, ..., lost], x[1, ..., lost] = data.values[k][:, lost].T[:, None], 0.0
            p[:2, :2, ..., lost] = start_p[..., lost]
        innovation = data.values[k] - x[0] - x[2]
        g = p[0] + p[2]
        s = g[0] + g[2] + r
        use = data.used[k]
        if gate < np.inf:
            use = use & (np.abs(innovation[-1] / np.sqrt(s[-1])).max(axis=0) <= gate)
        innovations[k], variances[k], uses[k] = innovation, s, use
        unseen_s[use] = 0.0
        gain = g * (use / s)
        x += gain * innovation
        p -= gain[:, None] * g
    terms = -0.5 * (np.log(2.0 * np.pi * variances) + innovations**2 / variances)
    normalised = np.where(data.used[:, None], innovations[:, -1] / np.sqrt(variances[:, -1]), np.nan)
    return np.where(uses[:, None, None], terms, 0.0).sum(axis=0), normalised
