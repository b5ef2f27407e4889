"""Checks of a recording after reading, shared by all readers, and smoothing of tracks without a measured truth.

Each names the file, the place in it, what is wrong and what is accepted. A `place` function turns the index of a frame
into its place in the file, such as ``row 17`` (a line of a table) or ``frame 12``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.interpolate import make_smoothing_spline

from gazempc.errors import RecordingError
from gazempc.types import BoolArray, FloatArray

Place = Callable[[int], str]

MIN_FRAMES = 4
QUATERNION_NORM_TOLERANCE = 1e-2

MAX_MAGNITUDE = 1e9  # larger values are damage, and their squares would overflow further on
_FRAME_INTERVAL_RANGE_S = (1.0 / 1000.0, 1.0)
_TYPICAL_FRAME_INTERVAL_S = 1.0 / 30.0
_TIME_UNITS_S = {
    "seconds": 1.0,
    "milliseconds": 1e-3,
    "microseconds": 1e-6,
    "nanoseconds": 1e-9,
    "minutes": 60.0,
}

TimeUnit = Literal["seconds", "microseconds"]


def check_frame_count(source: Path, count: int, minimum: int = MIN_FRAMES) -> None:
    """Refuse a recording that is too short to say anything about motion.

    Args:
        source: File that was read.
        count: Frames in it (with the person in view).
        minimum: Fewest frames accepted.

    Raises:
        RecordingError: If there are fewer.
    """
    if count < minimum:
        raise RecordingError(source, "", f"only {count} frame(s)", f"at least {minimum} frames")


def check_finite(source: Path, values: FloatArray, columns: Sequence[str], place: Place) -> None:
    """Refuse NaN, infinite and absurdly large values.

    Args:
        source: File that was read.
        values: Shape (N, C), in file order.
        columns: Names of the C columns.
        place: Words for a frame's index.

    Raises:
        RecordingError: Names the first such value's place and column.
    """
    bad = ~np.isfinite(values)
    bad |= np.abs(np.where(bad, 0.0, values)) > MAX_MAGNITUDE
    if bad.any():
        index, column = (int(k) for k in np.argwhere(bad)[0])
        raise RecordingError(
            source,
            f"{place(index)}, column {columns[column]}",
            f"the value is {values[index, column]:g}",
            f"a finite number no larger than {MAX_MAGNITUDE:g}",
        )


def check_times_increase(source: Path, times: FloatArray, place: Place) -> None:
    """Refuse time stamps that repeat, go backwards or are not finite.

    Args:
        source: File that was read.
        times: Shape (N,), in the file's unit.
        place: Words for a frame's index.

    Raises:
        RecordingError: Names the first such frame, its time stamp and the one before it.
    """
    expected = "finite time stamps, each larger than the one before"
    if not np.isfinite(times).all():
        index = int(np.argmin(np.isfinite(times)))
        raise RecordingError(source, place(index), f"the time stamp is {times[index]}", expected)
    steps = np.diff(times)
    if (steps > 0.0).all():
        return
    index = int(np.argmax(steps <= 0.0)) + 1
    before, now = float(times[index - 1]), float(times[index])
    problem = (
        f"duplicate time stamp {now!r} (the same in {place(index - 1)})"
        if now == before
        else f"time goes backwards, from {before!r} in {place(index - 1)} to {now!r}"
    )
    raise RecordingError(source, place(index), problem, expected)


def check_unit_quaternions(source: Path, quat_wxyz: FloatArray, columns: str, place: Place) -> None:
    """Refuse orientations that are not unit quaternions (to 1 %).

    Args:
        source: File that was read.
        quat_wxyz: Shape (N, 4), finite; rows of NaN are not known, and pass.
        columns: What people call these columns, such as ``head_q{w,x,y,z}``.
        place: Words for a frame's index.

    Raises:
        RecordingError: Names the first such frame, the columns and the norm.
    """
    norms = np.linalg.norm(quat_wxyz, axis=1)
    bad = np.abs(norms - 1.0) > QUATERNION_NORM_TOLERANCE
    if bad.any():
        index = int(np.argmax(bad))
        raise RecordingError(
            source,
            f"{place(index)}, columns {columns}",
            f"not a unit quaternion: its norm is {norms[index]:.4g}",
            f"a norm of 1 to within {QUATERNION_NORM_TOLERANCE:g}",
        )


def check_frame_interval(source: Path, times_s: FloatArray, unit: TimeUnit = "seconds") -> None:
    """Refuse time stamps in a wrong unit, told by the median interval between frames.

    Args:
        source: File that was read.
        times_s: Shape (N,), seconds if the file keeps to its format.
        unit: Unit the file's format prescribes, named in the message.

    Raises:
        RecordingError: If the median is outside 1 ms to 1 s; names the probable unit.
    """
    interval_s = float(np.median(np.diff(times_s)))
    low_s, high_s = _FRAME_INTERVAL_RANGE_S
    # Time stamps are rounded in files: a 1000 Hz recording must not fail by the last digit.
    if low_s * (1.0 - 1e-6) <= interval_s <= high_s * (1.0 + 1e-6):
        return
    raw = interval_s / _TIME_UNITS_S[unit]
    causes = {name: raw * size_s for name, size_s in _TIME_UNITS_S.items() if name != unit}
    fitting = [name for name, value in causes.items() if low_s <= value <= high_s]
    fitting.sort(key=lambda name: abs(np.log(causes[name] / _TYPICAL_FRAME_INTERVAL_S)))
    hint = ""
    if fitting:
        factor = _TIME_UNITS_S[fitting[0]] / _TIME_UNITS_S[unit]
        hint = f": looks like {fitting[0]} where {unit} belong, a factor of {factor_text(factor)}"
    raise RecordingError(
        source,
        "time stamps",
        f"the median interval between frames is {interval_s:.4g} s when read as {unit}{hint}",
        f"time stamps in {unit}, {low_s:g} to {high_s:g} s apart (median)",
    )


def factor_text(file_unit_over_true_unit: float) -> str:
    """How many times too large the values are, as 1000 or 1/1000."""
    factor = 1.0 / file_unit_over_true_unit
    return f"{factor:.4g}" if factor >= 1.0 else f"1/{1.0 / factor:.4g}"


LengthUnit = Literal["metres", "millimetres"]

HEAD_TO_PELVIS_RANGE_M = (0.3, 1.1)
_TYPICAL_HEAD_TO_PELVIS_M = 0.6
# Averaged over this time, jumps of a tracker do not count as speed.
_TRAVEL_S = 1.0
_FASTEST_M_S = 12.5  # the best sprinters' highest speed
_MOST_CLIMB_M = 1.0  # getting up from a chair, or a few steps of a staircase
_LENGTH_UNITS_M = {
    "metres": 1.0,
    "millimetres": 1e-3,
    "centimetres": 1e-2,
    "inches": 0.0254,
    "feet": 0.3048,
}


def check_head_to_pelvis(
    source: Path, head_position_m: FloatArray, pelvis_position_m: FloatArray, unit: LengthUnit = "metres"
) -> None:
    """Refuse positions in a wrong unit, told by the median distance from head to pelvis.

    Args:
        source: File that was read.
        head_position_m: Shape (N, 3), finite, metres if the file keeps to its format.
        pelvis_position_m: Shape (N, 3), likewise.
        unit: Unit the file's format prescribes, named in the message.

    Raises:
        RecordingError: If the median is outside 0.3 to 1.1 m; names the probable cause and its factor.
    """
    distance_m = median_head_to_pelvis_m(head_position_m, pelvis_position_m)
    low_m, high_m = HEAD_TO_PELVIS_RANGE_M
    if low_m <= distance_m <= high_m:
        return
    raw = distance_m / _LENGTH_UNITS_M[unit]
    causes = {
        f"{name} where {unit} belong, a factor of {factor_text(size_m / _LENGTH_UNITS_M[unit])}": raw * size_m
        for name, size_m in _LENGTH_UNITS_M.items()
        if name != unit
    }
    for factor in (25.4, 1000.0):  # a conversion done twice or the wrong way round
        for cause, true_m in (("large", distance_m / factor), ("small", distance_m * factor)):
            if not np.isclose(true_m, list(causes.values())).any():
                causes[f"values {factor:g} times too {cause}"] = true_m
    fitting = [cause for cause, value_m in causes.items() if low_m <= value_m <= high_m]
    # Ranges overlap (a short person in inches, a tall one 25.4 times too large): the likeliest comes first.
    fitting.sort(key=lambda cause: abs(np.log(causes[cause] / _TYPICAL_HEAD_TO_PELVIS_M)))
    hint = f": looks like {' (or else '.join(fitting)}{')' * (len(fitting) - 1)}" if fitting else ""
    raise RecordingError(
        source,
        "positions",
        f"the head is {distance_m:.4g} m from the pelvis (median) when read as {unit}{hint}",
        f"positions in {unit}, with {low_m:g} to {high_m:g} m from pelvis to head",
    )


def check_head_travel(source: Path, times_s: FloatArray, head_position_m: FloatArray) -> None:
    """Refuse head positions in a wrong unit or with another axis up, where no pelvis tells.

    Only impossible motion is noticed: a person who stands may have any unit.

    Args:
        source: File that was read.
        times_s: Shape (N,), seconds, increasing.
        head_position_m: Shape (N, 3), finite, metres with z up if the file keeps to its format.

    Raises:
        RecordingError: If the head travels faster than people run, or more along z than across it.
    """
    after = np.minimum(np.searchsorted(times_s, times_s + _TRAVEL_S), len(times_s) - 1)
    moved = after > np.arange(len(times_s))
    way_m = np.linalg.norm(head_position_m[after] - head_position_m, axis=1)[moved]
    speed_m_s = float(np.median(way_m / (times_s[after] - times_s)[moved]))
    if speed_m_s > _FASTEST_M_S:
        names = [name for name, size_m in _LENGTH_UNITS_M.items() if 0.1 < speed_m_s * size_m < 3.0]
        hint = f": looks like {' or '.join(names)} where metres belong" if names else ""
        raise RecordingError(
            source,
            "positions",
            f"the head travels at {speed_m_s:.4g} m/s (median) when read as metres{hint}",
            f"positions in metres, and a person slower than {_FASTEST_M_S:g} m/s",
        )
    x_m, y_m, z_m = np.ptp(head_position_m, axis=0)
    if z_m > max(_MOST_CLIMB_M, float(np.hypot(x_m, y_m))):
        raise RecordingError(
            source,
            "positions",
            f"z does not point up: the head moves by {z_m:.2f} m along z, ({x_m:.2f}, {y_m:.2f}) m along x and y",
            "metres with z up and a person who walks on a floor",
        )


def median_head_to_pelvis_m(head_position_m: FloatArray, pelvis_position_m: FloatArray) -> float:
    """Median distance from head to pelvis over the frames, metres."""
    return float(np.median(np.linalg.norm(head_position_m - pelvis_position_m, axis=1)))


def check_upright(source: Path, head_position_m: FloatArray, pelvis_position_m: FloatArray, hint: str) -> None:
    """Refuse a person who lies or stands on the head: another axis than z points up.

    Args:
        source: File that was read.
        head_position_m: Shape (N, 3), finite, metres, z meant to be up.
        pelvis_position_m: Shape (N, 3), likewise.
        hint: What is accepted, for the message.

    Raises:
        RecordingError: If the head is (in the median) not within 60 degrees of straight above the pelvis.
    """
    from_pelvis_m = np.median(head_position_m - pelvis_position_m, axis=0)
    if from_pelvis_m[2] < 0.5 * np.linalg.norm(from_pelvis_m):
        x_m, y_m, z_m = from_pelvis_m
        raise RecordingError(
            source,
            "positions",
            f"z does not point up: from pelvis to head is ({x_m:.2f}, {y_m:.2f}, {z_m:.2f}) m (median)",
            hint,
        )


# Longer than any walk before a robot; its replay takes an hour, too.
MOST_DURATION_S = 3600.0
# After a longer gap, another walk begins.
MOST_GAP_S = 60.0
# No sensor of a robot tells a head from farther away.
MOST_RANGE_M = 100.0
# In a frame of the floor the robot is placed beside the walk; across a campus is far enough.
MOST_EXTENT_M = 1000.0


def check_plausible(source: Path, times_s: FloatArray, head_position_m: FloatArray, at_sensor: bool) -> None:
    """Refuse recordings that last for hours, or of people kilometres away.

    Args:
        source: File, for messages.
        times_s: Times at which the head is known, shape (N,), seconds, increasing.
        head_position_m: Where it is, shape (N, 3), metres.
        at_sensor: Whether the frame's origin is the robot's sensor.

    Raises:
        RecordingError: Names the time, and what is accepted.
    """
    if not times_s.size:
        return
    steps_s = np.diff(times_s, prepend=times_s[0])
    after = int(np.argmax(steps_s))
    start_s = float(times_s[0])
    if steps_s[after] > MOST_GAP_S:
        raise RecordingError(
            source,
            "time stamps",
            f"a gap of {steps_s[after]:.4g} s, from {times_s[after - 1] - start_s:.4g} s after the first frame on",
            f"frames at most {MOST_GAP_S:g} s apart; a walk after a longer gap is another recording",
        )
    if times_s[-1] - start_s > MOST_DURATION_S:
        raise RecordingError(
            source,
            "time stamps",
            f"the recording lasts {(times_s[-1] - start_s) / 3600.0:.4g} h",
            f"{MOST_DURATION_S / 3600.0:g} h at most: cut it into walks",
        )
    away_m = head_position_m if at_sensor else head_position_m - np.median(head_position_m, axis=0)
    ranges_m = np.linalg.norm(away_m, axis=1)
    far, most_m = int(np.argmax(ranges_m)), MOST_RANGE_M if at_sensor else MOST_EXTENT_M
    if ranges_m[far] > most_m:
        from_what = "the sensor" if at_sensor else "the middle of the walk"
        raise RecordingError(
            source,
            "positions",
            f"{times_s[far] - start_s:.4g} s after the first frame the head is {ranges_m[far]:.4g} m from {from_what}",
            f"{most_m:g} m at most, in metres",
        )


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
