"""Frames that a sensor takes, their arrival and stamps, and the random processes of its errors."""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from gazempc.sim.sensing.tables import Bouts, Timing
from gazempc.types import BoolArray, FloatArray, IntArray


def wander(times_s: FloatArray, time_s: float, axes: int, rng: np.random.Generator) -> FloatArray:
    """Ornstein-Uhlenbeck process of unit variance, stationary from the first frame, exact for any spacing.

    Args:
        times_s: Times of the frames, shape (N,), seconds, increasing.
        time_s: Correlation time: the autocorrelation is exp(-lag / time_s).
        axes: How many independent ones, A.
        rng: Source of randomness.

    Returns:
        Shape (N, A).
    """
    values = rng.standard_normal((times_s.size, axes))
    keeps = np.exp(-np.diff(times_s) / time_s)
    kicks = values[1:] * np.sqrt(1.0 - keeps**2)[:, None]
    # In plain numbers: an operation on an array of a few takes ten times as long.
    kept = keeps.tolist()
    for a, start in enumerate(values[0].tolist()):
        steps = zip(kept, kicks[:, a].tolist(), strict=True)
        values[:, a] = list(accumulate(steps, lambda value, step: step[0] * value + step[1], initial=start))
    return values


def bouts(times_s: FloatArray, spec: Bouts, rng: np.random.Generator) -> IntArray:
    """Which frames are in a bout, and in which.

    Args:
        times_s: Times of the frames, shape (N,), seconds, increasing.
        spec: How often and how long.
        rng: Source of randomness.

    Returns:
        Number of the bout at each frame, from 0, shape (N,); -1 outside.
    """
    number = np.full(times_s.size, -1, dtype=np.intp)
    if spec.mean_interval_s == np.inf:
        return number
    count, end_s = 0, float(times_s[0])
    while True:
        start_s = end_s + rng.exponential(spec.mean_interval_s)
        first = int(np.searchsorted(times_s, start_s))
        if first == times_s.size:
            return number
        end_s = start_s + rng.uniform(spec.duration_min_s, spec.duration_max_s)
        # A bout between two frames hits the next one: a spike of no duration is still a spike.
        after = max(int(np.searchsorted(times_s, end_s)), first + 1)
        number[first:after] = count
        count += 1


def held_uniform(times_s: FloatArray, hold_s: float, rng: np.random.Generator) -> FloatArray:
    """Numbers of 0 to 1 that stay for an exponential time, then are drawn anew.

    Args:
        times_s: Times of the frames, shape (N,), seconds, increasing.
        hold_s: Mean time between draws; 0 for a draw each frame.
        rng: Source of randomness.

    Returns:
        Shape (N,), each uniform.
    """
    drawn = rng.random(times_s.size)
    stays = np.exp(-np.diff(times_s) / hold_s) if hold_s > 0 else np.zeros(times_s.size - 1)
    new: BoolArray = np.concatenate([[True], rng.random(times_s.size - 1) >= stays])
    held: FloatArray = drawn[np.maximum.accumulate(np.where(new, np.arange(times_s.size), 0))]
    return held


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
