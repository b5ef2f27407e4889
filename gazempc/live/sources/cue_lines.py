"""Cues as text: one JSON object a line, among the observations."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, get_args

import numpy as np

from gazempc.errors import suggest
from gazempc.live.sources.json_lines import LineError, number, numbers, short
from gazempc.people.company import Sound
from gazempc.people.cues import Cue, Glance, Rhythm, Speech, Thinking
from gazempc.settings import LookAwayMode

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
        LineError: If it is none; says which field is wrong and what is accepted.
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
