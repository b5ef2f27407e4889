"""Tracks that are not the truth as they stand: noisy ones, and ones relative to the hips."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError
from gazempc.recordings.readers.checks import check_frame_count
from gazempc.recordings.readers.smoothing import MIN_SEEN_FRAMES, smoothed
from gazempc.recordings.recording import Track
from gazempc.types import FloatArray

# Where hips are that the file puts at the origin: the pelvis of a person of 1.75 m who stands.
HIPS_HEIGHT_M = 0.95
# How near to the origin they must be.
_HIPS_AT_ORIGIN_M = 0.1


def smooth_track(path: Path, times_s: FloatArray, track: Track) -> Track:
    """The track without the tracker's noise, where the truth is unknown.

    Args:
        path: File it is from, for messages.
        times_s: Shape (N,), seconds.
        track: What the tracker saw.

    Returns:
        The same with positions smoothed without lag.

    Raises:
        RecordingError: If there are too few frames, or the time stamps do not allow it.
    """
    check_frame_count(path, len(times_s), MIN_SEEN_FRAMES)
    # Seconds since 1970 would spoil the spline's equations.
    times_s = times_s - times_s[0]
    pelvis_m = track.pelvis_position_m
    has_pelvis = np.asarray(np.isfinite(pelvis_m).all(axis=1))
    enough = int(has_pelvis.sum()) >= MIN_SEEN_FRAMES
    return replace(
        track,
        head_position_m=smoothed(path, times_s, track.head_position_m, track.valid),
        pelvis_position_m=smoothed(path, times_s, pelvis_m, has_pelvis) if enough else pelvis_m,
    )


def lifted_from_hips(path: Path, track: Track) -> tuple[Track, str]:
    """Positions relative to the hips, lifted to where hips are.

    Args:
        path: File they are from, for messages.
        track: The track, z up, the hips at the origin.

    Returns:
        The lifted track, and what is to be said of it.

    Raises:
        RecordingError: If the hips are elsewhere than at the origin, as in coordinates of the image.
    """
    from_origin_m = float(np.nanmedian(np.linalg.norm(track.pelvis_position_m, axis=1)))
    if not from_origin_m < _HIPS_AT_ORIGIN_M:
        raise RecordingError(
            path,
            "positions",
            f"the middle of the hips is {from_origin_m:.2f} from the origin (median)",
            "world landmarks, in metres from the middle of the hips; coordinates of the image have no depth",
        )
    lift_m = np.array([0.0, 0.0, HIPS_HEIGHT_M])
    lifted = replace(
        track,
        head_position_m=track.head_position_m + lift_m,
        pelvis_position_m=track.pelvis_position_m + lift_m,
    )
    note = f"positions are relative to the hips, which are put at {HIPS_HEIGHT_M} m"
    return lifted, f"{note}: how the person walks is not in the file"
