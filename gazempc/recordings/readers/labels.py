"""Labels of a recording: from the index file beside it, else from its name and the route group of its motion."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gazempc.files.bounds import MOST_TEXT_BYTES, read_limited
from gazempc.recordings.recording import Labels
from gazempc.types import FloatArray

_INDEX_NAME = "index.csv"
_INDEX_COLUMNS = {"clip", "subject", "group"}


def labels_for(path: Path, times_s: FloatArray, path_m: FloatArray) -> Labels:
    """Find a recording's labels.

    A file ``index.csv`` in the same folder with the columns clip, subject, group and, if it likes, kind and
    source_description wins for the clips it names. Otherwise the subject is the file's name up to the first
    underscore and the group follows from the motion.

    Args:
        path: The recording's file.
        times_s: Shape (N,), seconds, strictly increasing.
        path_m: Positions of the pelvis, or of the head where no pelvis is known, shape (N, 3), metres, z up; NaN
            where not seen.

    Returns:
        The labels.
    """
    row = _index_row(path)
    return Labels(
        subject=row.get("subject") or path.stem.split("_")[0] or path.stem,
        group=row.get("group") or route_group(times_s, path_m),
        description=row.get("source_description") or "",
        activity=row.get("kind") or None,
    )


def _index_row(path: Path) -> dict[str, str]:
    """Row of the index about this clip; empty where there is no index or it does not name the clip.

    A damaged or unrelated ``index.csv`` must not keep a sound recording from being read, so it is ignored.
    """
    try:
        text = read_limited(path.with_name(_INDEX_NAME), MOST_TEXT_BYTES).decode("utf-8-sig", errors="replace")
        rows = list(csv.reader(text.splitlines()))
    except (OSError, ValueError, csv.Error):
        return {}
    if not rows or not set(rows[0]) >= _INDEX_COLUMNS:
        return {}
    clip = rows[0].index("clip")
    for row in rows[1:]:
        if len(row) == len(rows[0]) and row[clip] == path.stem:
            return {name: cell.strip() for name, cell in zip(rows[0], row, strict=True)}
    return {}


RouteGroup = Literal["straight", "turn", "sharp"]

_TURN_FROM_DEG = 20.0
_SHARP_FROM_DEG = 75.0
_MIN_SPEED_M_S = 0.2
# Gait sways the pelvis sideways about once a second. A Gaussian of 0.45 s (s.d.) leaves under 2 % of that
# and reproduces the published groups of all 64 reference walks; 0.4 s and less lets sway count as turning.
_SMOOTHING_S = 0.45
_GRID_STEP_S = 1.0 / 30.0
_MAX_GRID_POINTS = 100_000


def route_group(times_s: FloatArray, position_m: FloatArray) -> RouteGroup:
    """Tell the group by the range of the direction of travel.

    Under 20 degrees is straight, over 75 sharp, between them a turn. Moments slower than 0.2 m/s have no
    direction and do not count; a person who stands is therefore straight.

    Args:
        times_s: Shape (N,), seconds, strictly increasing.
        position_m: Of the pelvis, which sways less, or of the head; shape (N, 3), metres, z up; rows with NaN are
            left out.

    Returns:
        The group's name.
    """
    return _group_of_range(travel_direction_range_deg(times_s, position_m))


def travel_direction_range_deg(times_s: FloatArray, position_m: FloatArray) -> float:
    """Range of the direction of travel after smoothing, in degrees; 0 where the person never walks.

    Args:
        times_s: Shape (N,), seconds, strictly increasing.
        position_m: Of the pelvis, which sways less, or of the head; shape (N, 3), metres, z up; rows with NaN are
            left out.

    Returns:
        Largest minus smallest direction of travel (unwrapped), degrees.
    """
    seen = np.isfinite(position_m).all(axis=1)
    times_s, path_m = times_s[seen], position_m[seen, :2]
    if len(times_s) < 2:
        return 0.0
    duration_s = times_s[-1] - times_s[0]
    # A regular grid makes the filter mean the same at any frame rate and across gaps.
    count = min(max(round(duration_s / _GRID_STEP_S) + 1, 2), _MAX_GRID_POINTS)
    grid_s = np.linspace(times_s[0], times_s[-1], count)
    step_s = grid_s[1] - grid_s[0]
    grid_m = np.column_stack([np.interp(grid_s, times_s, path_m[:, axis]) for axis in range(2)])
    smooth_m = gaussian_filter1d(grid_m, _SMOOTHING_S / step_s, axis=0, mode="nearest")
    velocity_m_s = np.gradient(smooth_m, step_s, axis=0)
    walking = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1]) >= _MIN_SPEED_M_S
    if not walking.any():
        return 0.0
    direction_rad = np.unwrap(np.arctan2(velocity_m_s[walking, 1], velocity_m_s[walking, 0]))
    return float(np.degrees(np.ptp(direction_rad)))


def _group_of_range(range_deg: float) -> RouteGroup:
    if range_deg < _TURN_FROM_DEG:
        return "straight"
    return "turn" if range_deg <= _SHARP_FROM_DEG else "sharp"
