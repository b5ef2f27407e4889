"""Walks whose head looks at something off the way."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np

from gazempc.recordings.recording import Recording, Track, turned

_GLANCE_RISE_S = 0.25


def turn_head(recording: Recording, angle_deg: float, from_s: float) -> Recording:
    """The recording with the head turned aside, by turns to the left and to the right from one name to the next.

    Args:
        recording: The recording.
        angle_deg: How far; 0 for not at all.
        from_s: When it begins, seconds after the first frame.

    Returns:
        The same walk with other head orientations, where they are known.
    """
    if angle_deg == 0.0:
        return recording
    side = 1.0 if zlib.crc32(recording.name.encode()) % 2 else -1.0
    after_s = recording.times_s - recording.times_s[0] - from_s
    angle = np.radians(angle_deg) * side * np.clip(after_s / _GLANCE_RISE_S if from_s else after_s + 1.0, 0.0, 1.0)

    def looking(track: Track) -> Track:
        return replace(track, head_quat_wxyz=turned(track.head_quat_wxyz, angle))

    measured = None if recording.measured is None else looking(recording.measured)
    return replace(recording, truth=looking(recording.truth), measured=measured)
