"""How far apart the fronts of two gazes are at equal smoothness, with intervals over people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gazempc.types import FloatArray

SMOOTHNESS = "rms_acceleration_rad_s2"
HEAD = "head_rms_acceleration_rad_s2"
ERROR, CONTACT = "gaze_error_rms_deg", "eye_contact_2p6"
_RESAMPLES, _SEED = 500, 20210603
Points = list[tuple[float, float]]


def front(points: Points, sign: float) -> Points:
    """The points that no other beats in both smoothness and value, smoothest first.

    Args:
        points: Pairs of smoothness (less is better) and value.
        sign: 1 if less of the value is better, -1 if more is.

    Returns:
        The front.
    """
    best: Points = []
    for smoothness, value in sorted(points, key=lambda p: (p[0], sign * p[1])):
        if not best or sign * value < sign * best[-1][1]:
            best.append((smoothness, value))
    return best


def at(points: Points, smoothness: float) -> float:
    """Value of a front at a smoothness: between its points on the line between them, past its last point as there.

    Args:
        points: A front.
        smoothness: Where.

    Returns:
        The value; NaN where the front does not reach.
    """
    if smoothness < points[0][0]:
        return math.nan
    return float(np.interp(smoothness, [p[0] for p in points], [p[1] for p in points]))


@dataclass(frozen=True)
class SweptGaze:
    """What one gaze did, point by point of its sweep; clips are the same for all points.

    Attributes:
        clips: Whose clip each is, shape (C,).
        values: Smoothness, error and contact of each point's clips, shape (P, 3, C).
    """

    clips: tuple[str, ...]
    values: FloatArray

    def means(self, weights: FloatArray) -> FloatArray:
        """Weighed means over the clips, shape (P, 3)."""
        means: FloatArray = self.values @ weights / weights.sum()
        return means


def gaze(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> SweptGaze:
    """Collect the runs of one gaze.

    Args:
        rows: Its runs, with ``point``, ``recording``, ``subject`` and the three metrics.
        names: Recordings to take, each of which every point has.

    Returns:
        What it did.
    """
    known = {(row["point"], row["recording"]): row for row in rows}
    points = sorted({row["point"] for row in rows})
    values = [[[known[p, name][m] for name in names] for m in (SMOOTHNESS, ERROR, CONTACT)] for p in points]
    return SweptGaze(tuple(known[points[0], name]["subject"] for name in names), np.array(values, dtype=np.float64))


def gaps(ours: SweptGaze, rival: SweptGaze) -> dict[str, Any]:
    """Compare at every point of the rival's front that ours reaches.

    Args:
        ours: A gaze.
        rival: Another one on the same clips.

    Returns:
        ``points`` of the rival's front that were compared; ``error_ratio`` and ``contact_difference``, means over
        these, each with ``_low`` and ``_high`` (95 %, people drawn anew; None with one person) and ``_worst``.
    """
    people = sorted(set(ours.clips))
    whose = np.array([people.index(person) for person in ours.clips])
    found: dict[str, Any] = {"points": 0} | {
        f"{name}{end}": None
        for name in ("error_ratio", "contact_difference")
        for end in ("", "_worst", "_low", "_high")
    }
    ratios, differences = _compared(ours, rival, np.ones(whose.size))
    found |= {"points": len(ratios)}
    if not ratios or not differences:
        return found
    found |= {"error_ratio": _mean_ratio(ratios), "error_ratio_worst": max(ratios)}
    found |= {"contact_difference": float(np.mean(differences)), "contact_difference_worst": min(differences)}
    if len(people) > 1:
        draws = np.random.default_rng(_SEED).integers(len(people), size=(_RESAMPLES, len(people)))
        weights = [np.bincount(draw, minlength=len(people))[whose].astype(np.float64) for draw in draws]
        drawn = [_compared(ours, rival, each) for each in weights]
        spreads = {
            "error_ratio": [_mean_ratio(ratios) for ratios, _ in drawn if ratios],
            "contact_difference": [float(np.mean(differences)) for _, differences in drawn if differences],
        }
        for name, values in spreads.items():
            low, high = np.percentile(values, [2.5, 97.5])
            found |= {f"{name}_low": float(low), f"{name}_high": float(high)}
    return found


def _mean_ratio(ratios: list[float]) -> float:
    return float(np.exp(np.mean(np.log(ratios))))


def _compared(ours: SweptGaze, rival: SweptGaze, weights: FloatArray) -> tuple[list[float], list[float]]:
    if not weights.any():
        return [], []
    means = [each.means(weights) for each in (ours, rival)]

    def pairs(column: int, sign: float) -> Points:
        mine, theirs = (front([(row[0], row[column]) for row in of.tolist()], sign) for of in means)
        both = [(at(mine, smoothness), value) for smoothness, value in theirs]
        return [pair for pair in both if not math.isnan(pair[0])]

    return [a / b for a, b in pairs(1, 1.0)], [a - b for a, b in pairs(2, -1.0)]
