"""Tracks smoothed without lag: the best estimate where the truth was not measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import make_smoothing_spline

from gazempc.errors import RecordingError
from gazempc.types import BoolArray, FloatArray

MIN_SEEN_FRAMES = 5  # the smoothing spline needs as many


def smoothed(path: Path, times_s: FloatArray, position_m: FloatArray, seen: BoolArray) -> FloatArray:
    """Smooth positions by a cubic spline, its strength by generalised cross-validation.

    Args:
        path: File, for messages.
        times_s: Shape (N,), seconds, increasing.
        position_m: Shape (N, 3), metres.
        seen: Where the positions are known, shape (N,).

    Returns:
        Shape (N, 3), metres; NaN where not seen.

    Raises:
        RecordingError: If the time stamps do not allow it.
    """
    smooth_m = np.full_like(position_m, np.nan)
    # In units of the frame interval the spline's equations are well scaled at any frame rate.
    knots = times_s[seen] / np.median(np.diff(times_s))
    for axis in range(3):
        try:
            smooth_m[seen, axis] = make_smoothing_spline(knots, position_m[seen, axis])(knots)
        except (ValueError, np.linalg.LinAlgError) as error:
            raise RecordingError(
                path, "time stamps", f"the track cannot be smoothed ({error})", "frames at a steady rate"
            ) from None
    return smooth_m
