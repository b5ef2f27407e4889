"""Plausibility checks of recordings, shared by all readers, and construction of a recording.

Each error names the file, the place in it, the problem and the accepted values. A `place` function turns the index of a
frame into its place in the file, such as ``row 17`` (a line of a table) or ``frame 12``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.interpolate import make_smoothing_spline

from gazempc.errors import RecordingError
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.recording import DataKind, Labels, Recording, Track, truth_of
from gazempc.types import FloatArray

Place = Callable[[int], str]

MIN_FRAMES = 4
MIN_SEEN_FRAMES = 5  # minimum for the smoothing spline
QUATERNION_NORM_TOLERANCE = 1e-2
MAX_MAGNITUDE = 1e9  # larger values are damage, and their squares would overflow
# Longer than any walk before a robot; a replay takes an hour.
MOST_DURATION_S = 3600.0
# Longest gap within one walk.
MOST_GAP_S = 60.0
# No sensor of a robot detects a head from farther away.
MOST_RANGE_M = 100.0
# For frames fixed to the floor: extent of a campus.
MOST_EXTENT_M = 1000.0
HEAD_TO_PELVIS_RANGE_M = (0.3, 1.1)
_FRAME_INTERVAL_RANGE_S = (1.0 / 1000.0, 1.0)
_TYPICAL_FRAME_INTERVAL_S, _TYPICAL_HEAD_TO_PELVIS_M, _TYPICAL_SPEED_M_S = 1.0 / 30.0, 0.6, 1.0
# Time base of the speed check, which averages out jumps of a tracker.
_TRAVEL_S = 1.0
_FASTEST_M_S = 12.5  # the best sprinters' highest speed
_MOST_CLIMB_M = 1.0  # getting up from a chair, or a few steps of a staircase
_TIMES_S = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9, "minutes": 60.0}
_LENGTHS_M = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254, "feet": 0.3048}


def recording_of(
    path: Path,
    times_s: FloatArray,
    track: Track,
    kind: DataKind,
    has_robot: bool,
    place: Place = "frame {}".format,
    note: str = "",
    notes: Sequence[str] = (),
    labels: Labels | None = None,
) -> Recording:
    """Check length, time stamps, units, vertical axis and plausibility of a track, and build the recording.

    For a track measured by a tracker, the truth is this track with positions smoothed without lag.

    Args:
        path: The file, or the name of the recording.
        times_s: Capture times, shape (N,), seconds.
        track: Poses, z up, at these times; finite where the person was seen.
        kind: Kind of data.
        has_robot: Whether the frame's origin is the robot's sensor.
        place: Place of a frame in the file.
        note: The format's units, and options that change the reading, for messages.
        notes: Notes on inferred and omitted data.
        labels: The labels; default: those of the index file beside the file.

    Returns:
        The recording, named after the file.

    Raises:
        RecordingError: Names the first check that fails.
    """
    measured, seen = bool(truth_of(kind)), track.valid
    fewest = MIN_SEEN_FRAMES if measured else MIN_FRAMES
    if seen.sum() < fewest:
        raise RecordingError(path, "", f"only {seen.sum()} frame(s)", f"at least {fewest} frames")
    check_times_increase(path, times_s, place)
    _check_frame_interval(path, times_s, note)
    head_m, pelvis_m = track.head_position_m, track.pelvis_position_m
    both = seen & np.isfinite(pelvis_m).all(axis=1)
    if both.any():
        _check_body(path, head_m[both] - pelvis_m[both], note)
    else:
        _check_head_travel(path, times_s[seen], head_m[seen])
    check_plausible(path, times_s[seen], head_m[seen], has_robot)
    if measured:
        head_m, pelvis_m = _smooth(path, times_s, head_m), _smooth(path, times_s, pelvis_m)
    path_m = pelvis_m if np.isfinite(pelvis_m).any() else head_m
    return Recording(
        name=path.stem,
        source=str(path),
        kind=kind,
        times_s=times_s,
        truth=replace(track, head_position_m=head_m, pelvis_position_m=pelvis_m),
        measured=track if measured else None,
        has_robot=has_robot,
        labels=labels or labels_for(path, times_s, path_m),
        notes=tuple(dict.fromkeys(notes)),
    )


def check_finite(source: Path, values: FloatArray, columns: Sequence[str], place: Place) -> None:
    """Reject NaN, infinite and implausibly large values.

    Args:
        source: File that was read.
        values: Shape (N, C), in file order.
        columns: Names of the C columns.
        place: Place of a frame in the file.

    Raises:
        RecordingError: Names place and column of the first such value.
    """
    bad = ~(np.abs(values) <= MAX_MAGNITUDE)
    if bad.any():
        index, column = (int(k) for k in np.argwhere(bad)[0])
        where, problem = f"{place(index)}, column {columns[column]}", f"the value is {values[index, column]:g}"
        raise RecordingError(source, where, problem, f"a finite number no larger than {MAX_MAGNITUDE:g}")


def check_times_increase(source: Path, times: FloatArray, place: Place) -> None:
    """Reject time stamps that repeat, go backwards or are not numbers.

    Args:
        source: File that was read.
        times: Shape (N,), in the file's unit.
        place: Place of a frame in the file.

    Raises:
        RecordingError: Names the first such frame, its time stamp and the one before it.
    """
    finite = np.isfinite(times)
    wrong = ~finite
    wrong[1:] |= times[1:] <= times[:-1]
    if wrong.any():
        index = int(np.argmax(wrong))
        now, before = times[index].item(), times[index - 1].item()
        problem = f"the time stamp {now!r} follows {before!r} in {place(index - 1)}"
        problem = problem if finite[index] else f"the time stamp is {now:g}"
        raise RecordingError(source, place(index), problem, "finite time stamps, each larger than the one before")


def check_unit_quaternions(source: Path, quat_wxyz: FloatArray, columns: str, place: Place) -> None:
    """Reject orientations that are not unit quaternions (to 1 %).

    Args:
        source: File that was read.
        quat_wxyz: Shape (N, 4), finite; rows of NaN are unknown, and pass.
        columns: Name of these columns, such as ``head_q{w,x,y,z}``.
        place: Place of a frame in the file.

    Raises:
        RecordingError: Names the first such frame, the columns and the norm.
    """
    norms = np.linalg.norm(quat_wxyz, axis=1)
    bad = np.abs(norms - 1.0) > QUATERNION_NORM_TOLERANCE
    if bad.any():
        index = int(np.argmax(bad))
        where, problem = f"{place(index)}, columns {columns}", f"not a unit quaternion: its norm is {norms[index]:.4g}"
        raise RecordingError(source, where, problem, f"a norm of 1 to within {QUATERNION_NORM_TOLERANCE:g}")


def check_plausible(source: Path, times_s: FloatArray, head_position_m: FloatArray, at_sensor: bool) -> None:
    """Check duration, gaps and distances of a recording.

    Args:
        source: File, for messages.
        times_s: Times at which the head is known, shape (N,), seconds, increasing.
        head_position_m: Its position, shape (N, 3), metres.
        at_sensor: Whether the frame's origin is the robot's sensor.

    Raises:
        RecordingError: Names the time and the accepted values.
    """
    since_s, steps_s = times_s - times_s[0], np.diff(times_s, prepend=times_s[0])
    after = int(np.argmax(steps_s))
    if steps_s[after] > MOST_GAP_S:
        problem = f"a gap of {steps_s[after]:.4g} s, from {since_s[after - 1]:.4g} s after the first frame on"
        expected = f"frames at most {MOST_GAP_S:g} s apart; a walk after a longer gap is another recording"
        raise RecordingError(source, "time stamps", problem, expected)
    if since_s[-1] > MOST_DURATION_S:
        problem, most_h = f"the recording lasts {since_s[-1] / 3600.0:.4g} h", MOST_DURATION_S / 3600.0
        raise RecordingError(source, "time stamps", problem, f"{most_h:g} h at most: cut it into walks")
    away_m = head_position_m if at_sensor else head_position_m - np.median(head_position_m, axis=0)
    ranges_m = np.linalg.norm(away_m, axis=1)
    far, most_m = int(np.argmax(ranges_m)), MOST_RANGE_M if at_sensor else MOST_EXTENT_M
    if ranges_m[far] > most_m:
        origin = "the sensor" if at_sensor else "the middle of the walk"
        problem = f"{since_s[far]:.4g} s after the first frame the head is {ranges_m[far]:.4g} m from {origin}"
        raise RecordingError(source, "positions", problem, f"{most_m:g} m at most, in metres")


def _check_frame_interval(source: Path, times_s: FloatArray, note: str) -> None:
    interval_s = float(np.median(np.diff(times_s)))
    low_s, high_s = _FRAME_INTERVAL_RANGE_S
    # Rounding of time stamps: of Unix times in double precision 2e-7 s, so up to 3e-4 of the interval at 1000 Hz.
    if not low_s * (1.0 - 1e-3) <= interval_s <= high_s * (1.0 + 1e-3):
        hint = _likely_unit(interval_s, "seconds", _TIMES_S, _FRAME_INTERVAL_RANGE_S, _TYPICAL_FRAME_INTERVAL_S)
        problem = f"the median interval between frames is {interval_s:.4g} s when read as seconds{hint}"
        expected = f"time stamps in seconds, {low_s:g} to {high_s:g} s apart (median){note}"
        raise RecordingError(source, "time stamps", problem, expected)


def _check_body(source: Path, from_pelvis_m: FloatArray, note: str) -> None:
    """Reject a wrong unit by the distance from pelvis to head, and a person who is not upright; shape (N, 3)."""
    distance_m, (low_m, high_m) = float(np.median(np.linalg.norm(from_pelvis_m, axis=1))), HEAD_TO_PELVIS_RANGE_M
    if not low_m <= distance_m <= high_m:
        hint = _likely_unit(distance_m, "metres", _LENGTHS_M, HEAD_TO_PELVIS_RANGE_M, _TYPICAL_HEAD_TO_PELVIS_M)
        problem = f"the head is {distance_m:.4g} m from the pelvis (median) when read as metres{hint}"
        expected = f"positions in metres, with {low_m:g} to {high_m:g} m from pelvis to head{note}"
        raise RecordingError(source, "positions", problem, expected)
    x_m, y_m, z_m = np.median(from_pelvis_m, axis=0)
    if z_m < 0.5 * np.linalg.norm((x_m, y_m, z_m)):
        problem = f"z does not point up: the vector from pelvis to head is ({x_m:.2f}, {y_m:.2f}, {z_m:.2f}) m (median)"
        raise RecordingError(source, "positions", problem, f"metres with z up and the person upright{note}")


def _check_head_travel(source: Path, times_s: FloatArray, head_position_m: FloatArray) -> None:
    """Check unit and vertical axis by the head's speed, without a pelvis; inconclusive for a standing person."""
    after = np.minimum(np.searchsorted(times_s, times_s + _TRAVEL_S), len(times_s) - 1)
    moved = after > np.arange(len(times_s))
    way_m = np.linalg.norm(head_position_m[after] - head_position_m, axis=1)[moved]
    speed_m_s = float(np.median(way_m / (times_s[after] - times_s)[moved]))
    if speed_m_s > _FASTEST_M_S:
        hint = _likely_unit(speed_m_s, "metres", _LENGTHS_M, (0.1, 3.0), _TYPICAL_SPEED_M_S)
        problem = f"the head travels at {speed_m_s:.4g} m/s (median) when read as metres{hint}"
        expected = f"positions in metres, and a person slower than {_FASTEST_M_S:g} m/s"
        raise RecordingError(source, "positions", problem, expected)
    x_m, y_m, z_m = np.ptp(head_position_m, axis=0)
    if z_m > max(_MOST_CLIMB_M, float(np.hypot(x_m, y_m))):
        problem = f"z does not point up: the head moves by {z_m:.2f} m along z, ({x_m:.2f}, {y_m:.2f}) m along x and y"
        raise RecordingError(source, "positions", problem, "metres with z up and a person who walks on a floor")


def _likely_unit(
    value: float, unit: str, sizes: Mapping[str, float], accepted: tuple[float, float], typical: float
) -> str:
    """End of a message: the unit that makes a value plausible, and its factor; empty if there is none."""
    found = {name: size for name, size in sizes.items() if accepted[0] <= value * size <= accepted[1]}
    if not found:
        return ""
    likely, size = min(found.items(), key=lambda item: abs(np.log(value * item[1] / typical)))
    factor = f"{1.0 / size:.4g}" if size <= 1.0 else f"1/{size:.4g}"
    return f": looks like {likely} instead of {unit}, a factor of {factor}"


def _smooth(path: Path, times_s: FloatArray, position_m: FloatArray) -> FloatArray:
    """Positions smoothed by a cubic spline, regularised by generalised cross-validation; shape (N, 3).

    NaN where not seen; unchanged where the person is seen too rarely.
    """
    smooth_m, seen = np.full_like(position_m, np.nan), np.isfinite(position_m).all(axis=1)
    if seen.sum() < MIN_SEEN_FRAMES:
        return position_m
    # In units of the frame interval the spline's equations are well scaled at any frame rate.
    knots = (times_s - times_s[0])[seen] / np.median(np.diff(times_s - times_s[0]))
    try:
        smooth_m[seen] = np.column_stack([make_smoothing_spline(knots, along)(knots) for along in position_m[seen].T])
    except (ValueError, np.linalg.LinAlgError) as error:
        problem = f"the track cannot be smoothed ({error})"
        raise RecordingError(path, "time stamps", problem, "frames at a constant rate") from None
    return smooth_m
