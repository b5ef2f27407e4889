"""Observations and cues as text: one JSON object a line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from gazempc.errors import shown, suggest
from gazempc.people.company import LONGEST_CUE_S, Cue, Glance, Rhythm, Sound, Speech, Thinking
from predictors import HeadObservation

_SHOWN = 80
_Vector = tuple[float, float, float]
_Quaternion = tuple[float, float, float, float]


class LineError(ValueError):
    """An invalid line; the message names the field and the accepted values."""


class _Fields(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)


class _Observation(_Fields):
    head_position_m: _Vector
    capture_time_s: float | None = None
    # Maximum age: older observations are useless for control; larger numbers are mostly milliseconds.
    age_s: Annotated[float, Field(ge=0, le=10)] | None = None
    head_quat_wxyz: _Quaternion | None = None
    pelvis_quat_wxyz: _Quaternion | None = None
    position_covariance_m2: tuple[_Vector, _Vector, _Vector] | None = None
    head_yaw_sd_rad: float | None = None
    pelvis_yaw_sd_rad: float | None = None
    confidence: float | None = None
    person_id: str | int | None = None


FIELDS = tuple(_Observation.model_fields)
_OPTIONAL = FIELDS[3:-1]


def parse_line(text: str, arrival_s: float, to_loop_s: Callable[[float], float]) -> HeadObservation:
    """Read one line.

    ``{"capture_time_s": 1763718300.25, "head_position_m": [2.1, 0.3, 0.4]}``, or ``age_s`` (age of the frame) in place
    of the Unix time. All other fields are optional, see `HeadObservation`; ``person_id`` may be a whole number, too.
    Positions are metres in the sensor's frame, x forward, y left, z up; identity quaternions face +x.

    Args:
        text: The line.
        arrival_s: Arrival time on the loop's clock, seconds.
        to_loop_s: Converts the stated capture time (by default Unix time) to the loop's clock.

    Returns:
        The observation in the sensor's frame.

    Raises:
        LineError: If it is invalid.
    """
    try:
        line = _Observation.model_validate_json(text)
    except ValidationError as error:
        raise LineError(_complaint(error, FIELDS)) from None
    if line.capture_time_s is not None and line.age_s is None:
        capture_s = to_loop_s(line.capture_time_s)
    elif line.age_s is not None and line.capture_time_s is None:
        capture_s = arrival_s - line.age_s
    else:
        raise LineError("expected one of capture_time_s (Unix time) and age_s (seconds since capture)")
    stated: dict[str, Any] = {name: getattr(line, name) for name in _OPTIONAL}
    person_id = None if line.person_id is None else str(line.person_id)
    try:
        return HeadObservation(capture_s, np.array(line.head_position_m), **stated, person_id=person_id)
    except ValueError as error:  # a quaternion not of unit length, an invalid covariance
        raise LineError(str(error)) from None


def _complaint(error: ValidationError, fields: tuple[str, ...]) -> str:
    """The first problem: field, accepted values, given value."""
    found = error.errors(include_url=False)[0]
    field = ".".join(map(str, found["loc"]))[:_SHOWN]
    if found["type"] == "extra_forbidden":
        return f"unknown field {field!r}: {suggest(field, fields)}"
    return f"{field + ': ' if field else ''}{found['msg']} (given: {shown(found['input'], _SHOWN)})"


_Seconds = Annotated[float, Field(ge=0, le=LONGEST_CUE_S)]


class _Sound(_Fields):
    cue: Literal["sound"]
    azimuth_rad: float


class _Thinking(_Fields):
    cue: Literal["thinking"]
    lasts_s: _Seconds


class _Speech(_Fields):
    cue: Literal["speech"]
    in_s: _Seconds


class _Glance(_Fields):
    cue: Literal["glance"]
    target_base_m: Annotated[_Vector, AfterValidator(np.array)]
    lasts_s: _Seconds


class _Rhythm(_Fields):
    cue: Literal["rhythm"]
    mode: Literal["listening", "speaking", "told"]


_Cue = Annotated[_Sound | _Thinking | _Speech | _Glance | _Rhythm, Field(discriminator="cue")]
_CUE: TypeAdapter[_Cue] = TypeAdapter(_Cue)
_MADE: dict[str, Any] = {"thinking": Thinking, "speech": Speech, "glance": Glance, "rhythm": Rhythm}


def is_cue(text: str) -> bool:
    """Whether a line is a cue: it has the field of a cue, and no head."""
    return '"cue"' in text and "head_position_m" not in text


def parse_cue(text: str, arrival_s: float) -> Cue:
    """Read one line.

    ``{"cue": "sound", "azimuth_rad": 0.3}``, ``{"cue": "thinking", "lasts_s": 1.5}``, ``{"cue": "speech", "in_s": 2}``,
    ``{"cue": "glance", "target_base_m": [1, 0.5, 0], "lasts_s": 1}`` or ``{"cue": "rhythm", "mode": "speaking"}``.

    Args:
        text: The line.
        arrival_s: Arrival time on the loop's clock, seconds.

    Returns:
        The cue.

    Raises:
        LineError: If it is invalid; names the field and the accepted values.
    """
    try:
        line = _CUE.validate_json(text)
    except ValidationError as error:
        raise LineError(_complaint(error, ())) from None
    name, *values = vars(line).values()
    made: Cue = _MADE[name](*values) if name != "sound" else Sound(arrival_s, *values)
    return made
