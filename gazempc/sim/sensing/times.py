"""Which frames of a recording a sensor takes, when they arrive, and what their stamps say."""

from __future__ import annotations

import numpy as np

from gazempc.sim.sensing.tables import Timing
from gazempc.types import FloatArray, IntArray


def frames_taken(times_s: FloatArray, rate_hz: float, jitter_s: float, rng: np.random.Generator) -> IntArray:
    """Frames of a recording that a sensor takes.

    A recording at (nearly) the sensor's rate or below is seen frame by frame; a faster one is thinned to the frames
    nearest to the sensor's ticks. With jitter it is always thinned, each frame at most once.

    Args:
        times_s: Times of the recording's frames, shape (N,), seconds.
        rate_hz: Greatest rate of the sensor.
        jitter_s: Frames come later than at the nominal rate by 0 to this.
        rng: Source of randomness.

    Returns:
        Their indices, increasing.
    """
    if jitter_s > 0:
        most = int((times_s[-1] - times_s[0]) * rate_hz) + 2
        waits = 1.0 / rate_hz + jitter_s * rng.random(most)
        ticks = times_s[0] + np.concatenate([[0.0], np.cumsum(waits)])
        ticks = ticks[ticks <= times_s[-1] + 1e-9]
    elif float(np.median(np.diff(times_s))) * rate_hz > 0.9:
        return np.arange(times_s.size)
    else:
        ticks = np.arange(times_s[0], times_s[-1] + 1e-9, 1.0 / rate_hz)
    after = np.clip(np.searchsorted(times_s, ticks), 1, times_s.size - 1)
    nearer_before = ticks - times_s[after - 1] < times_s[after] - ticks
    return np.unique(after - nearer_before)


def arrivals(times_s: FloatArray, latency_s: float, timing: Timing, rng: np.random.Generator) -> FloatArray:
    """When frames would arrive if none waited for another.

    Args:
        times_s: True capture times, shape (N,), seconds.
        latency_s: Least latency.
        timing: Its jitter.
        rng: Source of randomness.

    Returns:
        Shape (N,), seconds.
    """
    return np.asarray(times_s + (latency_s + timing.latency_jitter_s * rng.random(times_s.size)))


def stamps(times_s: FloatArray, timing: Timing, rng: np.random.Generator) -> FloatArray:
    """Capture times as the sensor stamps them.

    Args:
        times_s: True capture times, shape (N,), seconds.
        timing: Error of the stamps.
        rng: Source of randomness.

    Returns:
        Shape (N,), seconds.
    """
    return times_s + (timing.stamp_offset_s + timing.stamp_noise_s * rng.standard_normal(times_s.size))
