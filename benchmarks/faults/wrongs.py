"""Injected faults of a part: return values, exceptions and delays."""

from __future__ import annotations

import itertools
import random
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from gazempc.controllers.controller import ControllerError
from gazempc.errors import RobotError
from gazempc.live.sources.source import Arrived

Change = Callable[[Any], Any]
ISOLATED = "Predictor in a process of its own"


def _with(value: Any, **fields: Any) -> Any:
    """Copy of a frozen dataclass with replaced fields, without validation."""
    other = replace(value)
    for name, new in fields.items():
        object.__setattr__(other, name, new)
    return other


def _raise(error: BaseException) -> Change:
    def change(answer: Any) -> Any:
        raise error

    return change


def _delay(seconds: float) -> Change:
    """Delay each call."""

    def change(answer: Any) -> Any:
        time.sleep(seconds)
        return answer

    return change


def _compute(answer: Any) -> Any:
    until_s = time.perf_counter() + 0.05
    while time.perf_counter() < until_s:
        pass
    return answer


def hold_lock(answer: Any) -> Any:
    """Hold the global interpreter lock in one C call."""
    sum(range(4_000_000))
    return answer


def _first_call(take: Change) -> Change:
    """Inject a fault at the first call only."""
    left = [take]
    return lambda answer: left.pop()(answer) if left else answer


def _answers() -> dict[str, Change]:
    """Faults of any call; each family below adds its specific ones."""
    return {
        "raises": _raise(ValueError("made to fail")),
        "raises BaseException": _raise(BaseException("made to fail")),
        "sys.exit": _raise(SystemExit("leaving")),
        "text": lambda answer: "text",
        "None": lambda answer: None,
    }


def _blocks() -> dict[str, Change]:
    return {"blocks for 1 s": _first_call(_delay(1.0)), "15 ms each": _delay(0.015)}


_ARRAYS: dict[str, Change] = {
    "complex": lambda a: a + 1j,
    "objects": lambda a: a.astype(object),
    "text": lambda a: a.astype(str),
    "NaN": lambda a: a * np.nan,
    "infinite": lambda a: a + np.inf,
}


def _field(name: str) -> dict[str, Change]:
    """Invalid arrays in a field of the return value; also lists, which are valid."""

    def spoil(bad: Change, value: Any) -> Any:
        return _with(value, **{name: bad(getattr(value, name))})

    return {f"{name}: {kind}": partial(spoil, bad) for kind, bad in {"lists": np.ndarray.tolist, **_ARRAYS}.items()}


_OF_PLAN = ("position_rad", "velocity_rad_s", "acceleration_rad_s2")
_random = random.Random(0)


def _intermittent(answer: Any) -> Any:
    if _random.random() < 0.4:
        raise OSError("no acknowledgement")
    return answer


FAMILIES: dict[str, dict[str, Change]] = {
    "none": {"none": lambda answer: answer},
    "Controller.plan": {
        **_answers(), **_blocks(), **_field("position_rad"), **_field("velocity_rad_s"),
        "ControllerError": _raise(ControllerError("no plan")),
        "three joints": lambda p: _with(p, **{n: np.zeros((len(p.position_rad), 3)) for n in _OF_PLAN}),
        "events None": lambda p: _with(p, events=None),
        "faults None": lambda p: _with(p, faults=None),
        "50 rad outside": lambda p: _with(p, position_rad=p.position_rad + 50.0),
        "1e9 rad/s": lambda p: _with(p, velocity_rad_s=p.velocity_rad_s + 1e9),
        "leaps by 1 rad": lambda p: _with(p, position_rad=p.position_rad + np.sign(np.sin(70 * p.start_s))),
        "of the past": lambda p: _with(p, start_s=p.start_s - 9.0),
        "computes 50 ms each": _compute,
    },
    "Controller.forecast_times_s": {
        **_answers(), **_blocks(), **_ARRAYS,
        "none at all": lambda answer: np.empty(0),
        "100,000 times": lambda t: np.linspace(t[0], t[0] + 1.0, 100_000),
        "in a year": lambda t: t + 3e7,
    },
    "Predictor.update": _answers() | _blocks(),
    "Predictor.forecast": {
        **_answers(), **_blocks(), **_field("means_base_m"), **_field("covariances_m2"),
        "1e200 m away": lambda f: _with(f, means_base_m=f.means_base_m * 1e200),
        "one time less": lambda f: _with(f, times_s=f.times_s[:-1]),
    },
    "Robot.read_state": {
        **_answers(), **_blocks(), **_field("position_rad"),
        "RobotError": _raise(RobotError("unplugged")),
        "three joints": lambda s: _with(s, position_rad=np.zeros(3)),
        "time is text": lambda s: _with(s, time_s="now"),
        "time is NaN": lambda s: _with(s, time_s=np.nan),
        "a year old": lambda s: _with(s, time_s=s.time_s - 3e7),
        "1e9 rad/s": lambda s: _with(s, velocity_rad_s=s.velocity_rad_s + 1e9),
        "1e9 rad": lambda s: _with(s, position_rad=s.position_rad + 1e9),
        "stand still": lambda s: _with(s, position_rad=np.zeros(2)),
        "drift by 0.5 rad/s": lambda s: _with(s, position_rad=s.position_rad + 0.5 * (s.time_s - 1.0)),
        "leap by 0.5 rad": lambda s: _with(s, position_rad=s.position_rad + 0.5 * (s.time_s % 0.2 > 0.1)),
    },
    "Robot.send_command": {
        **_answers(), **_ARRAYS,
        "three joints": lambda answer: np.zeros(3),
        "1e9 rad": lambda sent: sent + 1e9,
        "raises now and then": _intermittent,
    },
    "Robot.true_state": {**_answers(), **_field("position_rad")},
    "Source.poll": {
        **_answers(), **_blocks(),
        "Arrived(None)": lambda answer: Arrived(None),  # type: ignore[arg-type]
        "sightings of text": lambda answer: Arrived(("here",)),  # type: ignore[arg-type]
        "problems as bytes": lambda answer: Arrived((), (b"raw",)),  # type: ignore[arg-type]
        "cues of text": lambda answer: Arrived((), cues=("sound",)),  # type: ignore[arg-type]
        "each 100 times": lambda a: Arrived(a.sightings * 100),
    },
    "Source.finished": {**_answers(), **_blocks(), "text": lambda answer: ""},
    "Robot.close": _answers() | _blocks(),
    "Source.close": _answers() | _blocks(),
    # These delay commands independently of the loop: the send call blocks, a simulator computes in the sending thread,
    # or the global interpreter lock is held.
    "Robot.send_command, blocking": _blocks(),
    "Robot.true_state, blocking": _blocks(),
    **{f"{call}, holding the lock": {"once": _first_call(hold_lock)} for call in (
        "Controller.plan", "Predictor.update", "Predictor.forecast", "Robot.read_state", "Source.poll",
    )},
    ISOLATED: {"holds the lock": lambda answer: answer},
}  # fmt: skip


def cases(short: bool = False) -> Iterator[tuple[str, str]]:
    """All faults, with an undisturbed run before each family; a subset with `short`."""
    for family, kinds in FAMILIES.items():
        if short and family != "Controller.plan":
            continue
        if family != "none":
            yield "none", "none"
        yield from ((family, kind) for kind in itertools.islice(kinds, 3 if short else None))
