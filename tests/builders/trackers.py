"""Tracks with known errors: a standing or walking person with wander and white noise."""

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from gazempc.identify.tracker.read import HeadTrack


def wander(rng, times_s, sd, correlation_s, axes=1):
    """Ornstein-Uhlenbeck process at a steady rate, shape (N, axes)."""
    keep = np.exp(-(times_s[1] - times_s[0]) / correlation_s)
    kicks = rng.standard_normal((times_s.size, axes))
    kicks[1:] *= np.sqrt(1.0 - keep**2)
    return sd * lfilter([1.0], [1.0, -keep], kicks, axis=0)


def person_m(rng, times_s, walks=False):
    """Head of a person at 2 m who sways by 4 mm, or walks to and fro at up to 1 m/s."""
    if walks:
        t = times_s
        return np.stack([2.5 + np.sin(0.5 * t), 1.5 * np.sin(0.6 * t), 0.2 + 0.02 * np.sin(12.0 * t)], axis=1)
    frames = 0.25 / (times_s[1] - times_s[0])
    sway = gaussian_filter1d(wander(rng, times_s, 0.005, 1.5, 3), frames, axis=0, mode="nearest")
    return np.array([2.0, 0.3, 0.2]) + sway


def seen_m(rng, true_m, times_s, along=(0.0, 0.0, 1.0), across_deg=(0.0, 0.0, 1.0)):
    """Observed positions: white error, wander, time constant, along (shares of the range) and across (degrees)."""
    range_m = np.linalg.norm(true_m, axis=1)
    left, up = np.arctan2(true_m[:, 1], true_m[:, 0]), np.arcsin(true_m[:, 2] / range_m)
    range_m = range_m * (1.0 + _error(rng, times_s, along)[:, 0])
    aside = np.deg2rad(_error(rng, times_s, across_deg, 2))
    left, up = left + aside[:, 0] / np.cos(up), up + aside[:, 1]
    return range_m[:, None] * np.stack([np.cos(up) * np.cos(left), np.cos(up) * np.sin(left), np.sin(up)], axis=1)


def _error(rng, times_s, sizes, axes=1):
    white, slow, correlation_s = sizes
    return white * rng.standard_normal((times_s.size, axes)) + wander(rng, times_s, slow, correlation_s, axes)


def track_of(times_s, position_m, head_yaw_rad=None, delays_s=None):
    """A track as built by the readers."""
    unknown = np.full(times_s.size, np.nan)
    yaw_rad = unknown if head_yaw_rad is None else head_yaw_rad
    return HeadTrack("anna", times_s, position_m, yaw_rad, unknown, delays_s)
