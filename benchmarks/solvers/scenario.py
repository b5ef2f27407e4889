"""The targets: a person who walks past, then standing persons in turn."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray
from predictors import ConstantVelocity, Forecast, HeadObservation

_NOISE_M = 0.01
_HOLD_TICKS = 50
# Where the targets are, pan and tilt; the person before them leaves at pan 63 deg, and the third is beyond the limits.
_TARGETS_DEG = ((-20, -15), (50, 30), (100, 60), (40, 10), (-35, -30), (20, -20))
_TARGET_DISTANCE_M = 1.5
# Speed of a standing person's head, at most.
_STANDING_M_S = 0.1


def heads_m(times_s: FloatArray) -> FloatArray:
    """Head of the person who walks past, shape (H, 3); at time 0 it is at a pan angle of 63 deg."""
    # The head goes up and down twice, and sideways once, a stride.
    stride = 2.0 * np.pi * 0.9 * times_s
    return np.stack([1.5 + 0.02 * np.sin(stride), 3.0 + 1.2 * times_s, 0.35 + 0.02 * np.sin(2.0 * stride)], axis=1)


def target_m(pan_deg: float, tilt_deg: float) -> FloatArray:
    """A head in a direction, shape (3,)."""
    pan, tilt = np.deg2rad((pan_deg, tilt_deg))
    return _TARGET_DISTANCE_M * np.array([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), np.sin(tilt)])


def forecasts(neck: NeckSpec, steps: int, ticks: int, seed: int) -> Iterator[Forecast]:
    """What is forecast at each control tick.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        ticks: Control ticks.
        seed: For the noise of what is seen.

    Yields:
        In the first four tenths, the way that a person really walks past. In the next two tenths, a constant-velocity
        forecast of them from noisy sightings. Then people who stand in one place after the other, each forecast at the
        mean of their noisy sightings.
    """
    rng = np.random.default_rng(seed)
    period_s, known, walking = neck.control_period_s, 4 * ticks // 10, 6 * ticks // 10
    ahead_s: FloatArray = neck.dead_time_s[0] + period_s * np.arange(1, steps + 1)
    predictor = ConstantVelocity(position_noise_m=_NOISE_M)
    since = -walking * period_s
    mean_noise_m = np.zeros(3)
    variances_m2 = _NOISE_M**2 + (_STANDING_M_S * ahead_s) ** 2
    for k in range(ticks):
        now_s, noise_m = k * period_s, rng.normal(scale=_NOISE_M, size=3)
        if k < walking:
            head_m = heads_m(np.array([since + now_s]))[0]
            predictor.update(HeadObservation(now_s, head_m + noise_m))
        if known <= k < walking:
            yield predictor.forecast(now_s + ahead_s)
            continue
        if k < known:
            means_m = heads_m(since + now_s + ahead_s)
        else:
            since_change = (k - walking) % _HOLD_TICKS
            target = _TARGETS_DEG[(k - walking) // _HOLD_TICKS % len(_TARGETS_DEG)]
            mean_noise_m = mean_noise_m + (noise_m - mean_noise_m) / (since_change + 1)
            means_m = np.tile(target_m(*target) + mean_noise_m, (len(ahead_s), 1))
        yield Forecast(now_s + ahead_s, means_m, variances_m2[:, None, None] * np.eye(3), now_s)
