"""Checks that all readers share; each names the file, the place in it, what was wrong and what belongs there.

Readers hand in a `place` function that turns a frame's index into words a person can find in the file, such
as ``row 17`` (a line of a table) or ``frame 12``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from gazempc.errors import RecordingError
from gazempc.types import FloatArray

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
