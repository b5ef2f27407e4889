"""The attended person over time in all figures: one bar per person, hatched during gaze aversion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gazempc.results.figures.style import Logs
from gazempc.results.log import Log
from gazempc.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Paul Tol's light scheme, for colour-blind people, too. Disjoint from the colours of controllers and contact.
_COLOURS = ("#EEDD88", "#99DDFF", "#FFAABB", "#BBCC33", "#EE8866", "#AAAA00")
_NO_PERSON = "#E0E0E0"
_WHY = {"policy": "chosen", "left": "previous person left"}
_HATCH, _BOX = "////", {"fc": "w", "ec": "none", "pad": 1.0}


@dataclass(frozen=True)
class Turn:
    """Period of attention to one person, with its aversions; times are from the start of the log.

    Attributes:
        from_s: Seconds.
        to_s: Seconds.
        number: Number of the person; 0 for none.
        why: Reason, as in the log.
    """

    from_s: float
    to_s: float
    number: int
    why: str

    @property
    def texts(self) -> tuple[str, ...]:
        """Labels of the period, longest first."""
        if not self.number:
            return ("no person",)
        name = f"person {self.number}"
        return (f"{name}: {_WHY[self.why]}", name, str(self.number)) if self.why in _WHY else (name, str(self.number))


def has_attention(logs: Logs) -> bool:
    """Whether any run has a choice of person or gaze aversion.

    Args:
        logs: The runs.
    """
    return any(log.attended_time_s.size or log.away_start_s.size for log in logs.values())


def question(logs: Logs) -> str:
    """The question of a picture or a report of a run.

    Args:
        logs: The runs.

    Returns:
        A question.
    """
    several = any(log.attended_time_s.size for log in logs.values())
    return f"Does the robot keep eye contact with {'the person it attends to' if several else 'a walking person'}?"


def turns(log: Log) -> tuple[Turn, ...]:
    """Periods of attention, in temporal order.

    Args:
        log: The run.

    Returns:
        The periods; one person for the whole run without a choice.
    """
    start_s, end_s = float(log.time_s[0]), float(log.time_s[-1])
    if not log.attended_time_s.size:
        return (Turn(0.0, end_s - start_s, 1, ""),)
    at_s = [*(log.attended_time_s - start_s).tolist(), end_s - start_s]
    each = zip(at_s, at_s[1:], log.attended_person.tolist(), log.attended_why.tolist(), strict=False)
    return tuple(Turn(*turn) for turn in each)


def looks_away(log: Log) -> tuple[tuple[float, float, str], ...]:
    """Gaze aversions: start, end (seconds from the start of the log) and reason.

    Args:
        log: The run.

    Returns:
        The aversions, up to the end of the log.
    """
    start_s, end_s = float(log.time_s[0]), float(log.time_s[-1])
    each = zip(log.away_start_s.tolist(), log.away_end_s.tolist(), log.away_why.tolist(), strict=True)
    return tuple((from_s - start_s, min(to_s, end_s) - start_s, why) for from_s, to_s, why in each)


def are_alike(logs: Logs) -> bool:
    """Whether all runs attend to the same people at the same times.

    Args:
        logs: The runs.
    """
    first, *others = [(turns(log), looks_away(log)) for log in logs.values()]
    return all(other == first for other in others)


def away_in_all(logs: Logs) -> tuple[tuple[float, float], ...]:
    """Intervals of gaze aversion in all runs.

    Args:
        logs: The runs.

    Returns:
        Beginnings and ends, seconds from the start.
    """
    ticks = min(log.time_s.size for log in logs.values())
    away = np.logical_and.reduce([log.looks_away[:ticks] for log in logs.values()])
    return spans(away, next(iter(logs.values())).time_s)


def spans(flags: BoolArray, time_s: FloatArray) -> tuple[tuple[float, float], ...]:
    """Beginnings and ends of the spans in which a flag is set, seconds from the first tick.

    Args:
        flags: The flag at each tick, shape (M,).
        time_s: Times of the ticks, at least as many, seconds.
    """
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    at_s = np.append(time_s, time_s[-1])[edges] - time_s[0]
    return tuple(zip(at_s[::2].tolist(), at_s[1::2].tolist(), strict=True))


def draw_turns(ax: Axes, log: Log, at: float, height: float, letters: float) -> None:
    """Draw the time line of a run.

    Args:
        ax: Axes, with the time along x.
        log: The run.
        at: Middle of the bars, on the y axis.
        height: Their height.
        letters: Number of letters that fit between 0 and the end of the log.
    """
    per_s = letters / max(float(log.time_s[-1] - log.time_s[0]), 1e-9)
    away = looks_away(log)
    for turn in turns(log):
        lasts_s = turn.to_s - turn.from_s
        ax.barh(at, lasts_s, height, turn.from_s, color=person_colour(turn.number), ec="w", lw=0.8)
        # The label is placed before the first aversion.
        to_s = min([from_s for from_s, *_ in away if turn.from_s < from_s < turn.to_s], default=turn.to_s)
        _write(ax, 0.5 * (turn.from_s + to_s), at, turn.texts, per_s * (to_s - turn.from_s))
    for from_s, to_s, why in away:
        ax.barh(at, to_s - from_s, height, from_s, fc=(1, 1, 1, 0.55), ec="0.35", hatch=_HATCH, lw=0.6)
        _write(ax, 0.5 * (from_s + to_s), at, (why,), per_s * (to_s - from_s), bbox=_BOX)


def person_colour(number: int) -> str:
    """Colour of a person in all figures.

    Args:
        number: Number of the person; 0 for none.

    Returns:
        A colour of matplotlib and CSS.
    """
    return _COLOURS[(number - 1) % len(_COLOURS)] if number else _NO_PERSON


def _write(ax: Axes, x: float, y: float, texts: Sequence[str], letters: float, **look: Any) -> None:
    fits = next((text for text in texts if len(text) + 1 <= letters), None)
    if fits is not None:
        ax.text(x, y, fits, ha="center", va="center", fontsize="small", clip_on=True, **look)
