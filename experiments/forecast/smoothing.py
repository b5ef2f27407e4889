"""The true walk behind a tracker's own track."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

from gazempc.recordings.recording import Recording
from gazempc.types import FloatArray

# As in `gazempc.recordings.truth`: over a longer gap a person may do anything.
_LONGEST_GAP_S = 0.2


def smooth_truth(recording: Recording, over_s: float) -> Recording:
    """Smooth the true head's path by a centred moving average in time, which does not lag.

    Between frames the track is taken to be straight. Towards an end of the track, or a gap of more than 0.2 s, the
    window becomes narrower on both sides, so that steady motion stays as it is.

    Args:
        recording: The recording; its truth is a tracker's, with the errors of that.
        over_s: Length of the window, seconds; 0 for no smoothing.

    Returns:
        The recording with the smooth truth. What a tracker measured of it is the track before, unless the recording has
        such a track of its own.
    """
    if over_s == 0.0:
        return recording
    track = recording.truth
    position_m = track.head_position_m.copy()
    seen = np.flatnonzero(track.valid)
    gaps = np.flatnonzero(np.diff(recording.times_s[seen]) > _LONGEST_GAP_S) + 1
    for rows in np.split(seen, gaps):
        position_m[rows] = _averaged(recording.times_s[rows], position_m[rows], over_s)
    return replace(recording, truth=replace(track, head_position_m=position_m), measured=recording.measured or track)


def _averaged(times_s: FloatArray, position_m: FloatArray, over_s: float) -> FloatArray:
    half_s = np.minimum(0.5 * over_s, np.minimum(times_s - times_s[0], times_s[-1] - times_s))
    wide = half_s > 0.0
    averaged = position_m.copy()
    if wide.any():
        area = make_interp_spline(times_s, position_m, k=1).antiderivative()
        around = area(times_s[wide] + half_s[wide]) - area(times_s[wide] - half_s[wide])
        averaged[wide] = around / (2.0 * half_s[wide, None])
    return averaged
