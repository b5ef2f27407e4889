"""The truth behind a tracker's track: a moving average with known effects."""

import numpy as np

from experiments.forecast.errors import smooth_truth
from gazempc.recordings.recording import Recording, Track

OVER_S = 0.4


def recorded(times_s, head_m, valid=None, measured=None):
    unknown = np.full((times_s.size, 4), np.nan)
    valid = np.ones(times_s.size, dtype=bool) if valid is None else valid
    head_m = np.where(valid[:, None], head_m, np.nan)
    track = Track(head_m, unknown, np.full_like(head_m, np.nan), unknown, valid)
    return Recording("made", "made here", "motion capture", times_s, track, measured, False)


def test_a_steady_walk_stays_as_it_is_to_its_ends_in_uneven_frames():
    times_s = np.sort(np.random.default_rng(0).uniform(0.0, 3.0, 90))
    head_m = np.array([1.0, 2.0, 1.6]) + np.outer(times_s, [1.2, -0.3, 0.0])
    smooth = smooth_truth(recorded(times_s, head_m), OVER_S).truth.head_position_m
    np.testing.assert_allclose(smooth, head_m, atol=1e-12)


def test_a_wave_is_lowered_by_its_sinc_and_does_not_lag():
    times_s = np.arange(0.0, 6.0, 0.01)
    rate_rad_s = 2.0 * np.pi * 1.5
    wave_m = np.stack([np.sin(rate_rad_s * times_s), np.cos(rate_rad_s * times_s), 0 * times_s], axis=1)
    smooth = smooth_truth(recorded(times_s, wave_m), OVER_S).truth.head_position_m
    inner = (times_s > OVER_S) & (times_s < 6.0 - OVER_S)
    lowered = np.sinc(rate_rad_s * OVER_S / 2.0 / np.pi)
    np.testing.assert_allclose(smooth[inner], lowered * wave_m[inner], atol=1e-3)


def test_nothing_is_averaged_over_a_gap():
    times_s = np.arange(0.0, 2.0, 0.02)
    side_m = np.where(times_s < 1.0, 0.0, 5.0)
    head_m = np.stack([side_m, side_m, 0 * side_m], axis=1)
    valid = (times_s < 0.8) | (times_s > 1.1)
    smooth = smooth_truth(recorded(times_s, head_m, valid), OVER_S).truth.head_position_m
    np.testing.assert_allclose(smooth[valid], head_m[valid], atol=1e-12)
    assert np.isnan(smooth[~valid]).all()
