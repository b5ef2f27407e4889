"""What could make the published errors: the time constant of the position filter, or turns.

Errors over the time constant, the one whose errors are nearest to the published ones, and the turns that would explain
them: a straight forecast of a person on an arc.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import brentq

from experiments.paper.frames import GROUPS, HORIZONS_S, Against, Frames, filter_time_s, frames_of
from experiments.paper.published import HORIZON_S, PUBLISHED
from experiments.paper.validation import exact_weight

# The default of `predictors.ConstantVelocity`, which errs least on walking people.
TUNED_TIME_S = round(filter_time_s(0.05), 4)
SLOW_TIME_S = 1.0
FILTER_TIMES_S = (0.05, TUNED_TIME_S, 0.15, 0.24, 0.4, 0.7, SLOW_TIME_S, 1.4, 2.0)
Rows = Sequence[dict[str, Any]]
AGAINST: tuple[Against, ...] = ("filtered", "true")


def sweep(rows_by_time: Mapping[float, Sequence[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Sweep the filter's time constant against w.

    Args:
        rows_by_time: For each time constant the rows of `experiments.paper.frames.labelled`.

    Returns:
        One row for each time constant, way to measure, horizon and group: the mean errors over the group's frames
        without the rule and with the w that is best for all groups together, with this filter.
    """
    table = []
    for time_s, rows in rows_by_time.items():
        for horizon_s in HORIZONS_S:
            for against in AGAINST:
                videos = frames_of(rows, against, horizon_s=horizon_s)
                if not videos:
                    continue
                weight = exact_weight(videos)
                way = {"filter_time_s": time_s, "against": against, "horizon_s": horizon_s}
                for group in groups_in(videos):
                    own = [v for v in videos if v.group == group]
                    errors = {"baseline_mm": mean_mm(own, 0.0), "weight": weight}
                    table.append(way | {"group": group} | errors | {"error_at_weight_mm": mean_mm(own, weight)})
    return table


def groups_in(videos: Sequence[Frames]) -> list[str]:
    """Codes of the groups that have videos, in the paper's order."""
    found = {v.group for v in videos}
    return [p.group for p in PUBLISHED if p.group in found]


def mean_mm(videos: Sequence[Frames], weight: float) -> float:
    """Mean error over all frames of some videos, mm."""
    return float(np.concatenate([v.error_mm(weight) for v in videos]).mean())


def closest_time_s(table: Rows, against: Against, horizon_s: float = HORIZON_S) -> float:
    """The time constant whose baseline errors are nearest to the published ones.

    Args:
        table: As made by `sweep`.
        against: Way to measure.
        horizon_s: Horizon.

    Returns:
        The time constant with the least root mean square of the errors' log ratios.
    """
    times_s: list[float] = [r["filter_time_s"] for r in table]
    return min(times_s, key=lambda time_s: misfit(table, time_s, against, horizon_s))


def _of_way(table: Rows, time_s: float, against: Against, horizon_s: float) -> list[dict[str, Any]]:
    return [r for r in table if (r["filter_time_s"], r["against"], r["horizon_s"]) == (time_s, against, horizon_s)]


def misfit(table: Rows, time_s: float, against: Against, horizon_s: float = HORIZON_S) -> float:
    """By how much the baseline errors of a filter differ from the published ones.

    Args:
        table: As made by `sweep`.
        time_s: Time constant.
        against: Way to measure.
        horizon_s: Horizon.

    Returns:
        Root mean square over the groups of the natural logarithm of their ratio: 0.1 stands for about 10 %.
    """
    published = {p.group: p.baseline_mm for p in PUBLISHED}
    own = _of_way(table, time_s, against, horizon_s)
    ratios = [math.log(r["baseline_mm"] / published[r["group"]]) for r in own]
    return math.sqrt(sum(x**2 for x in ratios) / len(ratios))


def nearest_at(table: Rows, horizon_s: float) -> list[dict[str, Any]]:
    """Filters whose baseline errors are nearest to the published ones.

    Args:
        table: As made by `sweep`.
        horizon_s: Horizon.

    Returns:
        For each way to measure the filter, its misfit, and its errors by group; empty without rows of the horizon.
    """
    nearest: list[dict[str, Any]] = []
    table = [r for r in table if r["horizon_s"] == horizon_s]
    for against in AGAINST if table else ():
        time_s = closest_time_s(table, against, horizon_s)
        own = _of_way(table, time_s, against, horizon_s)
        nearest.append(
            {
                "against": against,
                "filter_time_s": time_s,
                "misfit": misfit(table, time_s, against, horizon_s),
                "baseline_mm": {r["group"]: r["baseline_mm"] for r in own},
                "proposed_mm": {r["group"]: r["error_at_weight_mm"] for r in own},
                "weight": own[0]["weight"],
            }
        )
    return nearest


# At this turn the error of a straight forecast is largest: 1.26 times the way.
_LARGEST_TURN_RAD = 4.085


def turn_error_m(way_m: float, turn_rad: float) -> float:
    """Error of a forecast that goes straight on while the person walks an arc.

    With the way s = v T and the turn theta = omega T, the forecast is s along the first direction and the person is at
    ``s (exp(i theta) - 1) / (i theta)``.

    Args:
        way_m: Length of the arc, metres.
        turn_rad: Angle turned on it, radians.

    Returns:
        Distance between forecast and person, metres.
    """
    z = 1j * turn_rad
    return float(way_m * abs(1.0 - np.expm1(z) / z)) if turn_rad else 0.0


def turn_needed_rad(way_m: float, error_m: float) -> float | None:
    """The turn at which a forecast that goes straight on errs by so much; inverse of `turn_error_m`.

    Args:
        way_m: Length of the arc, metres.
        error_m: Error, metres.

    Returns:
        The least such turn in radians, or None where no turn makes the error so large.
    """
    if turn_error_m(way_m, _LARGEST_TURN_RAD) < error_m:
        return None
    return float(brentq(lambda turn: turn_error_m(way_m, turn) - error_m, 0.0, _LARGEST_TURN_RAD))


def turns_needed(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """For each group: how people walk in the data, and how all would have to turn all the time.

    Args:
        rows: As made by `experiments.paper.frames.labelled`.

    Returns:
        One row a group. It has the median speed, and how far people turn from one half second to the next (median and
        95th percentile of the absolute angle over frames). It has the published error of the baseline, too, and the
        turn in half a second that would cause it at every frame at the median speed (None if none would).
    """
    table = []
    for published in PUBLISHED:
        own = [r for r in rows if GROUPS.get(r["group"]) == published.group and r.get("speed_m_s")]
        if not own:
            continue
        speed_m_s = float(np.median(np.concatenate([r["speed_m_s"] for r in own])))
        turn_deg = np.abs(np.concatenate([r["turn_deg"] for r in own]))
        needed = turn_needed_rad(speed_m_s * HORIZON_S, 1e-3 * published.baseline_mm)
        table.append(
            {
                "group": published.group,
                "speed_m_s": speed_m_s,
                "turn_median_deg": float(np.median(turn_deg)),
                "turn_p95_deg": float(np.percentile(turn_deg, 95)),
                "published_mm": published.baseline_mm,
                "turn_needed_deg": None if needed is None else float(np.degrees(needed)),
            }
        )
    return table
