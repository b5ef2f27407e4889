"""What numbers say of their unit and axes, where people walk and stand."""

from __future__ import annotations

import numpy as np

from gazempc.recordings.readers.tables.times import TIMES_S
from gazempc.recordings.readers.tables.values import LENGTHS_M
from gazempc.types import FloatArray

_TYPICAL_INTERVAL_S = 1.0 / 30.0
_INTERVALS_S = (1.0 / 1000.0, 1.0)
# Seconds since 1970, from 2001 to 2100.
_CLOCK_S = (1e9, 4.1e9)
_TYPICAL_RANGE_M, _TYPICAL_SPEED_M_S, _HEAD_TO_PELVIS_M = 3.0, 1.0, 0.6
_STANDING_M_S = 0.05
# Heads of people who stand or sit, above the floor.
_HEIGHTS_M = (1.0, 2.2)


def likely_time_unit(values: FloatArray) -> str:
    """Unit of time stamps: by the clock they show, else by the interval between frames.

    Args:
        values: Shape (N,), of one person.

    Returns:
        A unit of `gazempc.recordings.readers.tables.times.TIMES_S`.
    """
    known = values[np.isfinite(values)]
    for unit in ("s", "ms", "us", "ns"):
        if known.size and _CLOCK_S[0] < known[0] * TIMES_S[unit] < _CLOCK_S[1]:
            return unit
    steps = np.diff(known)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else _TYPICAL_INTERVAL_S
    fitting = [u for u in ("s", "ms", "us", "ns") if _INTERVALS_S[0] <= step * TIMES_S[u] <= _INTERVALS_S[1]]
    return min(fitting or ["s"], key=lambda u: abs(np.log(step * TIMES_S[u] / _TYPICAL_INTERVAL_S)))


def likely_length(times_s: FloatArray, head: FloatArray, pelvis: FloatArray | None) -> str:
    """Unit of positions: by the distance from pelvis to head, else by distance and speed.

    Args:
        times_s: Shape (N,), seconds.
        head: Shape (N, 3), in the file's unit.
        pelvis: Likewise, or None.

    Returns:
        ``m``, ``mm`` or ``cm``.
    """
    known = np.isfinite(head).all(axis=1) & np.isfinite(times_s)
    head, times_s = head[known], times_s[known]
    if len(head) < 2:
        return "m"
    if pelvis is not None:
        apart = float(np.nanmedian(np.linalg.norm(head - pelvis[known], axis=1)))
        return min(("m", "mm", "cm"), key=lambda u: abs(np.log(max(apart, 1e-9) * LENGTHS_M[u] / _HEAD_TO_PELVIS_M)))
    away = float(np.median(np.linalg.norm(head, axis=1)))
    duration_s = max(float(times_s[-1] - times_s[0]), 1e-3)
    speed = float(np.linalg.norm(np.ptp(head, axis=0))) / duration_s

    def strangeness(unit: str) -> float:
        size_m = LENGTHS_M[unit]
        slow = speed * size_m < _STANDING_M_S and unit == "m"
        pace = 0.0 if slow else abs(np.log(max(speed * size_m, _STANDING_M_S) / _TYPICAL_SPEED_M_S))
        return float(abs(np.log(max(away, 1e-9) * size_m / _TYPICAL_RANGE_M)) + 0.5 * pace)

    return min(("m", "mm", "cm"), key=strangeness)


def likely_axes(head_m: FloatArray, pelvis_m: FloatArray | None) -> str:
    """Axes of positions: by where the head is above the pelvis, else by heights and by what is far away.

    Args:
        head_m: Shape (N, 3), metres.
        pelvis_m: Likewise, or None.

    Returns:
        A name of `gazempc.recordings.readers.tables.frames.AXES`.
    """
    if pelvis_m is not None:
        x, y, z = np.nanmedian(head_m - pelvis_m, axis=0)
        if abs(z) >= max(abs(x), abs(y)):
            return "z-up"
        return "y-up" if y > 0 else "optical"
    middle = np.nanmedian(head_m, axis=0)
    spread = np.nanmax(head_m, axis=0) - np.nanmin(head_m, axis=0)
    tall = [k for k in (2, 1) if _HEIGHTS_M[0] < middle[k] < _HEIGHTS_M[1] and spread[k] < _HEIGHTS_M[0]]
    if tall:
        return "z-up" if min(tall, key=lambda k: (spread[k] > 0.3, k != 2)) == 2 else "y-up"
    # Seen from a sensor: what is far is forward, x or the z of a camera.
    return "optical" if middle[2] > max(abs(middle[0]), abs(middle[1])) else "z-up"
