"""Labels of a recording: from the index file beside it, else from its name and motion."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gazempc.files.bounds import MOST_TEXT_BYTES, read_limited
from gazempc.recordings.recording import Labels
from gazempc.types import FloatArray

Group = Literal["standing", "straight", "turn", "sharp"]

STANDING = "standing"
ROUTES = ("straight", "turn", "sharp")
SPOT_RADIUS_M = 0.7
"""Length of a step; 0.6-0.75 m in walking adults. Largest displacement of a standing person without a pause: 0.67 m
(directing traffic, motion capture). Smallest of 152 starting pedestrians: 0.9 m."""
START_SPEED_M_S = 0.3
START_LASTS_S = 0.5

_TURN_FROM_DEG = 20.0
_SHARP_FROM_DEG = 75.0
_MIN_SPEED_M_S = 0.2
# Gait sways the pelvis sideways about once a second. A Gaussian of 0.45 s (s.d.) leaves under 2 % of that
# and reproduces the published groups of all 64 reference walks; at 0.4 s and less, sway is classified as turning.
_SMOOTHING_S = 0.45
# Window of the central difference for the speed: over one frame, a jump of 0.1 m would be a speed of 3 m/s, over
# 0.3 s it is 0.33 m/s, and the required duration and distance of a start exclude it.
_SPEED_WINDOW_S = 0.3
_GRID_STEP_S = 1.0 / 30.0
_MAX_GRID_POINTS = 100_000


class Travel(NamedTuple):
    """Locomotion of a person.

    Attributes:
        start_s: Start of motion, seconds; NaN where there is none.
        leaves: Whether the person leaves the spot at any time.
    """

    start_s: float
    leaves: bool


def travel(times_s: FloatArray, position_m: FloatArray) -> Travel:
    """Whether a person leaves the spot, and the start of motion.

    The person moves while the horizontal speed is over 0.3 m/s for 0.5 s or longer and the displacement exceeds a step
    (0.7 m); leans and turns on the spot do not count. The start of motion is the beginning of the first such interval
    after at least 0.5 s of rest, which shorter intervals do not interrupt. A person leaves the spot who moves, or who
    is at any time more than a step from the median position.

    Args:
        times_s: Shape (N,), seconds, strictly increasing.
        position_m: Positions of head or pelvis, shape (N, 3), metres, z up; rows with NaN are left out.

    Returns:
        The start, and whether the person leaves the spot.
    """
    grid_s, path_m = _on_grid(times_s, position_m)
    if grid_s.size < 2:
        return Travel(np.nan, False)
    index = np.arange(grid_s.size)
    half = max(1, round(0.5 * _SPEED_WINDOW_S / (grid_s[1] - grid_s[0])))
    before, after = np.maximum(index - half, 0), np.minimum(index + half, index[-1])
    speed_m_s = np.linalg.norm(path_m[after] - path_m[before], axis=1) / (grid_s[after] - grid_s[before])
    edges = np.flatnonzero(np.diff(speed_m_s > START_SPEED_M_S, prepend=False, append=False))
    start_s, moves, rest_from_s = np.nan, False, grid_s[0]
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        if grid_s[last] - grid_s[first] < START_LASTS_S:
            continue
        if np.linalg.norm(path_m[first : last + 1] - path_m[first], axis=1).max() > SPOT_RADIUS_M:
            moves = True
            if np.isnan(start_s) and grid_s[first] - rest_from_s >= START_LASTS_S:
                start_s = float(grid_s[first])
        rest_from_s = grid_s[last]
    strays_m = np.linalg.norm(path_m - np.median(path_m, axis=0), axis=1).max()
    return Travel(start_s, moves or bool(strays_m > SPOT_RADIUS_M))


def route_group(times_s: FloatArray, position_m: FloatArray) -> Group:
    """Group of a recording by its motion.

    A person who does not leave the spot (`travel`) is standing. Otherwise the range of the direction of travel
    determines the group: under 20 degrees is straight, over 75 sharp, between them a turn. Samples slower than 0.2 m/s
    are excluded.

    Args:
        times_s: Shape (N,), seconds, strictly increasing.
        position_m: Positions of the pelvis, which sways less, or of the head; shape (N, 3), metres, z up; rows with NaN
            are left out.

    Returns:
        The group's name.
    """
    if not travel(times_s, position_m).leaves:
        return "standing"
    grid_s, path_m = _on_grid(times_s, position_m)
    step_s = grid_s[1] - grid_s[0]
    smooth_m = gaussian_filter1d(path_m, _SMOOTHING_S / step_s, axis=0, mode="nearest")
    velocity_m_s = np.gradient(smooth_m, step_s, axis=0)
    walking = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1]) >= _MIN_SPEED_M_S
    direction_rad = np.unwrap(np.arctan2(velocity_m_s[walking, 1], velocity_m_s[walking, 0]))
    if not walking.any() or np.degrees(np.ptp(direction_rad)) < _TURN_FROM_DEG:
        return "straight"
    return "turn" if np.degrees(np.ptp(direction_rad)) <= _SHARP_FROM_DEG else "sharp"


def _on_grid(times_s: FloatArray, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times, shape (G,), and horizontal positions, (G, 2), on a regular grid; unchanged for fewer than two known rows.

    On a regular grid, filters are independent of frame rate and gaps.
    """
    seen = np.isfinite(position_m).all(axis=1)
    times_s, path_m = times_s[seen], position_m[seen, :2]
    if len(times_s) < 2:
        return times_s, path_m
    count = min(max(round((times_s[-1] - times_s[0]) / _GRID_STEP_S) + 1, 2), _MAX_GRID_POINTS)
    grid_s = np.linspace(times_s[0], times_s[-1], count)
    return grid_s, np.column_stack([np.interp(grid_s, times_s, path_m[:, axis]) for axis in range(2)])


_INDEX_NAME = "index.csv"
_INDEX_COLUMNS = {"clip", "subject", "group"}
# Activities in one place, regardless of the route in an index.
_STAYING = frozenset({"standing", "sitting", "waiting"})


def labels_for(path: Path, times_s: FloatArray, path_m: FloatArray) -> Labels:
    """Find a recording's labels.

    A file ``index.csv`` in the same folder with the columns clip, subject, group and optionally kind and
    source_description has priority for its clips. Otherwise the subject is the file's name up to the first underscore
    and the group follows from the motion. The group is ``standing`` where the activity is standing, sitting or waiting,
    or, without an activity, where the person does not leave the spot; this overrides a route in the index, but not the
    user's own groups.

    Args:
        path: The recording's file.
        times_s: Shape (N,), seconds, strictly increasing.
        path_m: Positions of the pelvis, or of the head where no pelvis is known, shape (N, 3), metres, z up; NaN
            where not seen.

    Returns:
        The labels.
    """
    row = _index_row(path)
    group, activity = row.get("group"), row.get("kind") or None
    if not group or group in ROUTES:
        by_motion = route_group(times_s, path_m)
        stays = by_motion == STANDING if activity is None else activity in _STAYING
        group = STANDING if stays else group or by_motion
    return Labels(
        subject=row.get("subject") or path.stem.split("_")[0] or path.stem,
        group=group,
        description=row.get("source_description") or "",
        activity=activity,
    )


def _index_row(path: Path) -> dict[str, str]:
    """Row of the index for this clip; empty if there is none.

    A damaged or unrelated ``index.csv`` is ignored, so that the recording can still be read.
    """
    try:
        text = read_limited(path.with_name(_INDEX_NAME), MOST_TEXT_BYTES).decode("utf-8-sig", errors="replace")
        rows = list(csv.DictReader(text.splitlines()))
    except (OSError, ValueError, csv.Error):
        return {}
    whole = (row for row in rows if row.keys() >= _INDEX_COLUMNS and None not in row and None not in row.values())
    return next(({name: cell.strip() for name, cell in row.items()} for row in whole if row["clip"] == path.stem), {})
