"""Checks of positions that all readers share: a wrong unit, or another axis than z up."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from gazempc.errors import RecordingError
from gazempc.recordings.readers.checks import factor_text
from gazempc.types import FloatArray

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
