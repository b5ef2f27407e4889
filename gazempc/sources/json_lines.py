"""Observations as text: one JSON object a line."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from gazempc.errors import suggest
from predictors import HeadObservation

FIELDS = ("capture_time_s", "age_s", "head_position_m", "head_quat_wxyz", "pelvis_quat_wxyz")
_SHOWN = 80


class LineError(ValueError):
    """A line is not an observation; says which field is wrong and what is accepted."""


def parse_line(text: str, arrival_s: float, from_unix_s: Callable[[float], float]) -> HeadObservation:
    """Read one line.

    ``{"capture_time_s": 1763718300.25, "head_position_m": [2.1, 0.3, 0.4]}``, or ``age_s`` (how long ago the frame was
    captured) in place of the Unix time; ``head_quat_wxyz`` and ``pelvis_quat_wxyz`` are optional. Positions are metres
    in the sensor's frame, x forward, y left, z up; identity quaternions face +x.

    Args:
        text: The line.
        arrival_s: When it came, on the loop's clock.
        from_unix_s: Converts Unix time to the loop's clock.

    Returns:
        The observation in the sensor's frame.

    Raises:
        LineError: If it is not one.
    """
    try:
        data: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise LineError(f"not JSON ({error}): {_short(text)}") from None
    if not isinstance(data, dict):
        raise LineError(f"expected an object with {', '.join(FIELDS)}, got {_short(text)}")
    if unknown := [name for name in data if name not in FIELDS]:
        raise LineError(f"unknown field {unknown[0]!r}: {suggest(unknown[0], FIELDS)}")
    if data.get("head_position_m") is None:
        raise LineError("head_position_m is missing: needed are three metres, x forward, y left, z up")
    has_time, has_age = data.get("capture_time_s") is not None, data.get("age_s") is not None
    if has_time == has_age:
        raise LineError("needed is one of capture_time_s (Unix time) and age_s (seconds since capture)")
    stamp = _number(data, "capture_time_s" if has_time else "age_s")
    if has_age and stamp < 0:
        raise LineError(f"age_s is {stamp:g}: needed are 0 or more seconds")
    try:
        return HeadObservation(
            capture_time_s=from_unix_s(stamp) if has_time else arrival_s - stamp,
            head_position_base_m=data["head_position_m"],
            head_quat_wxyz=data.get("head_quat_wxyz"),
            pelvis_quat_wxyz=data.get("pelvis_quat_wxyz"),
        )
    except (ValueError, TypeError) as error:
        raise LineError(str(error).replace("head_position_base_m", "head_position_m")) from None


def _number(data: dict[str, Any], name: str) -> float:
    value = data[name]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise LineError(f"{name} is {value!r}: needed is a number of seconds")
    return float(value)


def _short(text: str) -> str:
    text = text.strip()
    return repr(text if len(text) <= _SHOWN else text[:_SHOWN] + "...")
