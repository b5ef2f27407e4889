"""Compare the Pareto fronts of two gazes in a sweep: `python -m experiments.fronts out/sweep/fronts`.

Each case varies a trade-off between accuracy and smoothness. The two are compared at the RMS acceleration of every
point of the rival's front from the first point of the other front on, which is constant after its last point: the error
as a ratio, the eye contact as a difference. A line of the table is the mean over these points with its 95 % interval
over people, and the worst point. With eyes the acceleration is the head's.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from pydantic import Field
from scipy.stats import gmean

from experiments.aggregate import GROUP_ORDER, grouped
from experiments.engine.command import Command
from experiments.pages import markdown, write_json
from gazempc.errors import SettingsError
from gazempc.settings import Settings
from gazempc.types import FloatArray

SMOOTHNESS = "rms_acceleration_rad_s2"
HEAD = "head_rms_acceleration_rad_s2"
ERROR, CONTACT = "gaze_error_rms_deg", "eye_contact_2p6"
_METRICS = (SMOOTHNESS, ERROR, CONTACT)
_RESAMPLES, _SEED = 500, 20210603
# Names, averages and worst values of the compared quantities.
_COMPARED: Sequence[tuple[str, Callable[[Any], Any], Callable[[Any], float]]] = (
    ("error_ratio", gmean, max),
    ("contact_difference", np.mean, min),
)
Points = list[tuple[float, float]]


def front(points: Points, sign: float) -> Points:
    """Pareto front of smoothness and value, smoothest first.

    Args:
        points: Pairs of smoothness (less is better) and value.
        sign: 1 if a lower value is better, -1 if a higher one is.

    Returns:
        The front.
    """
    best: Points = []
    for smoothness, value in sorted(points, key=lambda p: (p[0], sign * p[1])):
        if not best or sign * value < sign * best[-1][1]:
            best.append((smoothness, value))
    return best


def at(points: Points, smoothness: float) -> float:
    """Value of a front at a smoothness: linear interpolation, constant after the last point.

    Args:
        points: A front.
        smoothness: Abscissa.

    Returns:
        The value; NaN before the first point.
    """
    if smoothness < points[0][0]:
        return math.nan
    return float(np.interp(smoothness, [p[0] for p in points], [p[1] for p in points]))


def measured(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> FloatArray:
    """Metrics of one gaze as an array.

    Args:
        rows: Its runs, with ``point``, ``recording`` and the three metrics.
        names: The C recordings, present at every point.

    Returns:
        Smoothness, error and eye contact by point and clip, shape (P, 3, C).
    """
    known = {(row["point"], row["recording"]): row for row in rows}
    points = sorted({row["point"] for row in rows})
    return np.array([[[known[p, name][m] for name in names] for m in _METRICS] for p in points], dtype=np.float64)


def gaps(ours: FloatArray, rival: FloatArray, people: Sequence[str]) -> dict[str, Any]:
    """Compare two gazes at the points of the rival's front, from the first point of the other one's on; see `at`.

    Args:
        ours: Metrics of a gaze, from `measured`, shape (P, 3, C).
        rival: Metrics of the other gaze on the same clips, shape (Q, 3, C).
        people: Person in each clip, shape (C,).

    Returns:
        ``points``, the number of compared points; ``error_ratio`` and ``contact_difference``, means over these, each
        with ``_low`` and ``_high`` (95 % bootstrap interval over people; None with one person) and ``_worst``.
    """
    names, person_index = np.unique(people, return_inverse=True)
    weights = [np.ones(person_index.size)]
    if len(names) > 1:
        draws = np.random.default_rng(_SEED).integers(len(names), size=(_RESAMPLES, len(names)))
        weights += [np.bincount(draw, minlength=len(names))[person_index].astype(np.float64) for draw in draws]
    compared = [_compared(ours, rival, each) for each in weights]
    found: dict[str, Any] = {"points": len(compared[0][0])}
    for k, (name, mean, worst) in enumerate(_COMPARED):
        values, spread = compared[0][k], [float(mean(each[k])) for each in compared[1:] if each[k]]
        found |= {name: float(mean(values)) if values else None, f"{name}_worst": worst(values) if values else None}
        ends = np.percentile(spread, [2.5, 97.5]).tolist() if spread else [None, None]
        found |= dict(zip((f"{name}_low", f"{name}_high"), ends, strict=True))
    return found


def _compared(ours: FloatArray, rival: FloatArray, weights: FloatArray) -> tuple[list[float], list[float]]:
    means = [values @ weights / weights.sum() for values in (ours, rival)]

    def pairs(column: int, sign: float) -> Points:
        own_front, rival_front = (front([(row[0], row[column]) for row in of.tolist()], sign) for of in means)
        both = [(at(own_front, smoothness), value) for smoothness, value in rival_front]
        return [pair for pair in both if not math.isnan(pair[0])]

    return [a / b for a, b in pairs(1, 1.0)], [a - b for a, b in pairs(2, -1.0)]


Row = dict[str, Any]


class FrontsSettings(Settings):
    """Settings of `python -m experiments.fronts`."""

    sweep: Annotated[Path, tyro.conf.Positional] = Field(description="Output folder of `experiments.sweep`")
    case: str = Field(default="mpc", description="Case to compare")
    rival: str = Field(default="lookahead", description="Reference case")


def fronts(settings: FrontsSettings, _: str = "") -> int:
    """Compare, print, and write ``fronts.json`` beside the sweep's tables.

    Args:
        settings: Sweep and cases.

    Returns:
        0.

    Raises:
        SettingsError: If the folder has no such sweep or cases.
    """
    runs = _read(settings.sweep / "results.csv")
    cases = sorted({row["case"] for row in runs})
    for name in (settings.case, settings.rival):
        if name not in cases:
            raise SettingsError(f"{settings.sweep / 'results.csv'}: no case {name!r}; accepted: {', '.join(cases)}")
    by = [name for name in ("neck", "sensor", "predictor") if name in runs[0]]
    found = []
    for place, here in sorted(grouped(runs, *by).items()):
        of = [[row for row in here if row["case"] == case] for case in (settings.case, settings.rival)]
        for group in (*(g for g in GROUP_ORDER if any(row["group"] == g for row in here)), "all"):
            names = _common([row for row in [*of[0], *of[1]] if group in {"all", row["group"]}])
            person_index = {row["recording"]: row["subject"] for row in here}
            ours, rival = (measured(rows, names) for rows in of)
            compared = gaps(ours, rival, [person_index[name] for name in names])
            found.append(dict(zip(by, place, strict=True)) | {"group": group} | compared)
    write_json(settings.sweep / "fronts.json", found)
    print(f"{settings.case} against {settings.rival} at the same RMS acceleration, mean over the front [95 %, people]:")
    head = (*by, "group", "points", "RMS error, %", "worst", "eye contact 2.6 deg, points", "worst")
    rows = (
        (
            *(str(m[name]) for name in (*by, "group", "points")),
            *(_cell(m, "error_ratio", -1.0), _one(m["error_ratio_worst"], -1.0)),
            *(_cell(m, "contact_difference", 0.0), _one(m["contact_difference_worst"], 0.0)),
        )
        for m in found
    )
    print(markdown(head, rows))
    print(f"Written to {settings.sweep}/: fronts.json")
    return 0


def _one(value: float | None, add: float) -> str:
    return "-" if value is None else f"{100.0 * (value + add):+.1f}"


def _cell(margin: Row, name: str, add: float) -> str:
    text = _one(margin[name], add)
    if margin[f"{name}_low"] is None:
        return text
    return f"{text} [{_one(margin[f'{name}_low'], add)}, {_one(margin[f'{name}_high'], add)}]"


def _common(runs: Sequence[Row]) -> list[str]:
    """Recordings at every point of every case."""
    names = ({row["recording"] for row in of_point} for of_point in grouped(runs, "case", "point").values())
    return sorted(set.intersection(*names))


def _read(path: Path) -> list[Row]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows: list[Row] = list(csv.DictReader(file))
    except FileNotFoundError:
        raise SettingsError(f"{path}: no such file; run python -m experiments.sweep first") from None
    if not rows or (missing := {"case", "point", "recording", "subject", "group", *_METRICS} - set(rows[0])):
        raise SettingsError(f"{path}: {f'lacks {sorted(missing)}' if rows else 'is empty'}")
    done = []
    for number, row in enumerate(rows, start=2):
        # With eyes, smoothness refers to the head.
        row[SMOOTHNESS] = row.get(HEAD) or row[SMOOTHNESS]
        if all(row[name] for name in _METRICS):  # failed and left-out runs have no metrics
            try:
                done.append(row | {name: float(row[name]) for name in _METRICS})
            except ValueError as error:
                raise SettingsError(f"{path}, row {number}: {error}") from None
    return done


main = Command("fronts", FrontsSettings, __doc__, fronts).main

if __name__ == "__main__":
    raise SystemExit(main())
