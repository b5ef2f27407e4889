"""Observations and cues as text: one JSON object a line."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any, get_args

import numpy as np

from gazempc.errors import suggest
from gazempc.people.company import Cue, Glance, Rhythm, Sound, Speech, Thinking
from gazempc.settings import LookAwayMode
from predictors import HeadObservation

_QUATERNIONS = ("head_quat_wxyz", "pelvis_quat_wxyz")
_NUMBERS = ("head_yaw_sd_rad", "pelvis_yaw_sd_rad", "confidence")
FIELDS = (
    *("capture_time_s", "age_s", "head_position_m"),
    *_QUATERNIONS,
    *("position_covariance_m2", *_NUMBERS, "person_id"),
)
_AXES = 3
# Older observations are of no use for control.
_OLDEST_S = 10.0
_SHOWN = 80


class LineError(ValueError):
    """A line is not an observation; names the field and what is accepted."""


def parse_line(text: str, arrival_s: float, to_loop_s: Callable[[float], float]) -> HeadObservation:
    """Read one line.

    ``{"capture_time_s": 1763718300.25, "head_position_m": [2.1, 0.3, 0.4]}``, or ``age_s`` (how long ago the frame was
    captured) in place of the Unix time. All other fields are optional, and what they mean stands at `HeadObservation`;
    ``person_id`` may be a whole number, too. Positions are metres in the sensor's frame, x forward, y left, z up;
    identity quaternions face +x.

    Args:
        text: The line.
        arrival_s: When it came, on the loop's clock.
        to_loop_s: Puts a capture time as stated (in the format: Unix time) on the loop's clock.

    Returns:
        The observation in the sensor's frame.

    Raises:
        LineError: If it is not one.
    """
    try:
        data: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise LineError(f"not JSON ({error}): {short(text)}") from None
    if not isinstance(data, dict):
        raise LineError(f"expected an object with {', '.join(FIELDS)}, got {short(text)}")
    if unknown := [name for name in data if name not in FIELDS]:
        raise LineError(f"unknown field {unknown[0]!r}: {suggest(unknown[0], FIELDS)}")
    if data.get("head_position_m") is None:
        raise LineError("head_position_m is missing: needed are three metres, x forward, y left, z up")
    has_time, has_age = data.get("capture_time_s") is not None, data.get("age_s") is not None
    if has_time == has_age:
        raise LineError("needed is one of capture_time_s (Unix time) and age_s (seconds since capture)")
    if has_age:
        age_s = number("age_s", data["age_s"])
        if age_s < 0:
            raise LineError(f"age_s is {age_s:g}: needed are 0 or more seconds")
        if age_s > _OLDEST_S:
            raise LineError(
                f"age_s is {age_s:g}: looks like milliseconds, or is no age; needed are seconds since capture"
            )
        capture_s = arrival_s - age_s
    else:
        capture_s = to_loop_s(number("capture_time_s", data["capture_time_s"]))
    position_m = numbers("head_position_m", data["head_position_m"], 3)
    stated = {name: _stated(name, data[name]) for name in FIELDS[3:] if data.get(name) is not None}
    try:
        return HeadObservation(capture_s, np.array(position_m), **stated)
    except ValueError as error:  # a quaternion that is not of unit length, a covariance that is none
        raise LineError(str(error)) from None


def _stated(name: str, value: Any) -> Any:
    if name in _QUATERNIONS:
        return np.array(numbers(name, value, 4))
    if name == "position_covariance_m2":
        if not isinstance(value, list) or len(value) != _AXES:
            raise LineError(f"{name} is {short(repr(value))}: needed are 3 lists of 3 numbers")
        return np.array([numbers(name, row, _AXES) for row in value])
    if name in _NUMBERS:
        return number(name, value)
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise LineError(f"{name} is {short(repr(value))}: needed is a text or a whole number")
    return str(value)


def number(name: str, value: Any) -> float:
    """A finite number.

    Args:
        name: Name of the field, for the message.
        value: Its value.

    Returns:
        The number.

    Raises:
        LineError: If it is none.
    """
    if not isinstance(value, bool) and isinstance(value, int | float):
        try:
            found = float(value)
        except OverflowError:
            found = math.inf
        if math.isfinite(found):
            return found
    raise LineError(f"{name} has {short(repr(value))}: needed is a finite number")


def numbers(name: str, values: Any, size: int) -> list[float]:
    """Finite numbers.

    Args:
        name: Name of the field, for the message.
        values: Its value.
        size: How many are needed.

    Returns:
        The numbers.

    Raises:
        LineError: If it is no list of so many.
    """
    if not isinstance(values, list) or len(values) != size:
        raise LineError(f"{name} is {short(repr(values))}: needed is a list of {size} numbers")
    return [number(name, value) for value in values]


def short(text: str) -> str:
    """The beginning of a text, for a message."""
    text = text.strip()
    return repr(text if len(text) <= _SHOWN else text[:_SHOWN] + "...")


_MARK = "cue"
_MODES = [mode for mode in get_args(LookAwayMode) if mode != "no"]


def is_cue(text: str) -> bool:
    """Whether a line is a cue, and not an observation: it names one, and no head."""
    return f'"{_MARK}"' in text and "head_position_m" not in text


def parse_cue(text: str, arrival_s: float) -> Cue:
    """Read one line.

    ``{"cue": "sound", "azimuth_rad": 0.3}``, ``{"cue": "thinking", "lasts_s": 1.5}``, ``{"cue": "speech", "in_s": 2}``,
    ``{"cue": "glance", "target_base_m": [1, 0.5, 0], "lasts_s": 1}`` or ``{"cue": "rhythm", "mode": "speaking"}``.

    Args:
        text: The line.
        arrival_s: When it came, on the loop's clock.

    Returns:
        The cue.

    Raises:
        LineError: If it is none; names the field and what is accepted.
    """
    try:
        data: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise LineError(f"not JSON ({error}): {short(text)}") from None
    if not isinstance(data, dict):
        raise LineError(f"expected an object with a cue, got {short(text)}")
    makers: Mapping[str, tuple[tuple[str, ...], Callable[[], Cue]]] = {
        "sound": (("azimuth_rad",), lambda: Sound(arrival_s, number("azimuth_rad", data["azimuth_rad"]))),
        "thinking": (("lasts_s",), lambda: Thinking(number("lasts_s", data["lasts_s"]))),
        "speech": (("in_s",), lambda: Speech(number("in_s", data["in_s"]))),
        "glance": (
            ("target_base_m", "lasts_s"),
            lambda: Glance(
                np.array(numbers("target_base_m", data["target_base_m"], 3)), number("lasts_s", data["lasts_s"])
            ),
        ),
        "rhythm": (("mode",), lambda: Rhythm(_mode(data["mode"]))),
    }
    kind = str(data.get(_MARK))
    if kind not in makers:
        raise LineError(f"no cue {kind!r}: {suggest(kind, makers)}")
    fields, make = makers[kind]
    if set(data) != {_MARK, *fields}:
        raise LineError(f"a cue {kind!r} needs the fields {', '.join(fields)} and no others, got {', '.join(data)}")
    return make()


def _mode(value: Any) -> LookAwayMode:
    if value in _MODES:
        mode: LookAwayMode = value
        return mode
    raise LineError(f"mode is {value!r}: {suggest(str(value), _MODES)}")
