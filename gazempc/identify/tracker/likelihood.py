"""How likely a track is: a person who moves smoothly, seen with wander and white noise.

Each axis by itself is position and velocity driven by white acceleration (the person), plus an Ornstein-Uhlenbeck
process (the tracker's wander), plus white noise. A Kalman filter gives the likelihood at the true times of the frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gazempc.types import BoolArray, FloatArray

# In the first frame of a stretch nothing is known of the person: 1 rad or a share of 1, and 1 m/s.
_START_VARIANCE = 1.0
_START_SPEED_M_S = 1.0
# A person may have gone anywhere meanwhile.
_PATIENCE_S = 1.0


@dataclass(frozen=True)
class Stretches:
    """Pieces of a track, padded to one length.

    Attributes:
        intervals_s: Time since the frame before, shape (F, B), seconds; 0 in the first frame and in the padding.
        values: What was measured on each axis, shape (F, A, B).
        used: Frames that count, shape (F, B); False in the padding and in frames that are left out.
        scales_m: What one unit of `values` is in metres, shape (B,).
    """

    intervals_s: FloatArray
    values: FloatArray
    used: BoolArray
    scales_m: FloatArray


@dataclass(frozen=True)
class ErrorModel:
    """Parameters of the process for G trials and A axes, each of shape (G, A).

    Attributes:
        acceleration: Intensity of the person's acceleration, m s^-1.5.
        white: Standard deviation of the white error, in the unit of the values.
        wander: Standard deviation of the wander, in the unit of the values.
        correlation_s: Correlation time of the wander, seconds.
    """

    acceleration: FloatArray
    white: FloatArray
    wander: FloatArray
    correlation_s: FloatArray


@dataclass(frozen=True)
class Likelihood:
    """What the filter finds.

    Attributes:
        log: Log-likelihood of each trial, axis and stretch, shape (G, A, B).
        surprise: Innovation over its standard deviation, shape (F, A, B), of the last trial; NaN in the padding.
    """

    log: FloatArray
    surprise: FloatArray


def likelihood(data: Stretches, model: ErrorModel, gate: float = np.inf) -> Likelihood:
    """Filter all stretches with all trials at once.

    After a second without a frame that was used, the filter starts anew at the next one.

    Args:
        data: F frames of B stretches on A axes.
        model: G trials.
        gate: A frame whose innovation is larger than so many standard deviations on any axis is not used.

    Returns:
        Likelihood and innovations.
    """
    frames, axes, count = data.values.shape
    trials = model.white.shape[0]
    shape = (trials, axes, count)
    q = (model.acceleration[..., None] / data.scales_m) ** 2
    r, w2 = model.white[..., None] ** 2, model.wander[..., None] ** 2
    # What depends on the times only, for all frames at once: numpy takes longer to be called than to count.
    steps_s = data.intervals_s[:, None, None, :]
    decays = np.exp(-steps_s / model.correlation_s[..., None])
    squares = decays**2
    added_xx, added_xv, added_vv = q * steps_s**3 / 3.0, q * steps_s**2 / 2.0, q * steps_s
    added_ww = w2 * (1.0 - squares)
    start_v = np.broadcast_to((_START_SPEED_M_S / data.scales_m) ** 2, shape)
    x = np.broadcast_to(data.values[0], shape).copy()
    v, w = np.zeros(shape), np.zeros(shape)
    pxx, pxv, pxw = np.full(shape, _START_VARIANCE), np.zeros(shape), np.zeros(shape)
    pvv, pvw, pww = start_v.copy(), np.zeros(shape), np.broadcast_to(w2, shape).copy()
    innovations, variances = np.zeros((frames, *shape)), np.ones((frames, *shape))
    uses = np.zeros((frames, count), dtype=bool)
    silent_s = np.zeros(count)
    for k in range(frames):
        dt, decay = data.intervals_s[k], decays[k]
        silent_s = silent_s + dt
        x = x + v * dt
        w = w * decay
        pxx = pxx + dt * (2.0 * pxv + dt * pvv) + added_xx[k]
        pxv = pxv + dt * pvv + added_xv[k]
        pxw = (pxw + dt * pvw) * decay
        pvv = pvv + added_vv[k]
        pvw = pvw * decay
        pww = pww * squares[k] + added_ww[k]
        lost = silent_s > _PATIENCE_S
        if lost.any():
            x = np.where(lost, data.values[k], x)
            v = np.where(lost, 0.0, v)
            pxx = np.where(lost, _START_VARIANCE, pxx)
            pxv, pvv = np.where(lost, 0.0, pxv), np.where(lost, start_v, pvv)
        innovation = data.values[k] - x - w
        gx, gv, gw = pxx + pxw, pxv + pvw, pxw + pww
        s = gx + gw + r
        use = data.used[k]
        if gate < np.inf:
            use = use & (np.abs(innovation[-1] / np.sqrt(s[-1])).max(axis=0) <= gate)
        innovations[k], variances[k], uses[k] = innovation, s, use
        silent_s[use] = 0.0
        share = use / s
        kx, kv, kw = gx * share, gv * share, gw * share
        x, v, w = x + kx * innovation, v + kv * innovation, w + kw * innovation
        pxx, pxv, pxw = pxx - kx * gx, pxv - kx * gv, pxw - kx * gw
        pvv, pvw, pww = pvv - kv * gv, pvw - kv * gw, pww - kw * gw
    terms = -0.5 * (np.log(2.0 * np.pi * variances) + innovations**2 / variances)
    surprise = innovations[:, -1] / np.sqrt(variances[:, -1])
    return Likelihood(
        np.where(uses[:, None, None], terms, 0.0).sum(axis=0), np.where(data.used[:, None], surprise, np.nan)
    )
