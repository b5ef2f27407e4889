"""Possible causes of the published errors: the time constant of the position filter, or turns.

Errors as a function of the time constant, the constant with the best fit to the published errors, and the turns for
which a straight forecast of a person on an arc has these errors.
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

# Default of `predictors.ConstantVelocity`, which minimises the error on walking people.
TUNED_TIME_S = round(filter_time_s(0.05), 4)
SLOW_TIME_S = 1.0
FILTER_TIMES_S = (0.05, TUNED_TIME_S, 0.15, 0.24, 0.4, 0.7, SLOW_TIME_S, 1.4, 2.0)
Rows = Sequence[dict[str, Any]]
AGAINST: tuple[Against, ...] = ("filtered", "true")


def sweep(rows_by_time: Mapping[float, Sequence[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Errors as a function of the filter's time constant, without the rule and at the best w.

    Args:
        rows_by_time: Rows of `experiments.paper.frames.labelled` by time constant.

    Returns:
        One row per time constant, reference, horizon and group: mean errors over the group's frames without the rule,
        and with the w that is optimal over all groups with this filter.
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
    """Codes of the groups with videos, in the paper's order."""
    found = {v.group for v in videos}
    return [p.group for p in PUBLISHED if p.group in found]


def mean_mm(videos: Sequence[Frames], weight: float) -> float:
    """Mean error over all frames of some videos, mm."""
    return float(np.concatenate([v.error_mm(weight) for v in videos]).mean())


def closest_time_s(table: Rows, against: Against, horizon_s: float = HORIZON_S) -> float:
    """Time constant with the least misfit to the published baseline errors.

    Args:
        table: Result of `sweep`.
        against: Reference of the errors.
        horizon_s: Horizon.

    Returns:
        The time constant, seconds; see `misfit`.
    """
    times_s: list[float] = [r["filter_time_s"] for r in table]
    return min(times_s, key=lambda time_s: misfit(table, time_s, against, horizon_s))


def _of_way(table: Rows, time_s: float, against: Against, horizon_s: float) -> list[dict[str, Any]]:
    return [r for r in table if (r["filter_time_s"], r["against"], r["horizon_s"]) == (time_s, against, horizon_s)]


def misfit(table: Rows, time_s: float, against: Against, horizon_s: float = HORIZON_S) -> float:
    """Misfit of a filter's baseline errors to the published ones.

    Args:
        table: Result of `sweep`.
        time_s: Time constant.
        against: Reference of the errors.
        horizon_s: Horizon.

    Returns:
        RMS over the groups of the natural logarithm of the ratio; 0.1 is about 10 %.
    """
    published = {p.group: p.baseline_mm for p in PUBLISHED}
    own = _of_way(table, time_s, against, horizon_s)
    ratios = [math.log(r["baseline_mm"] / published[r["group"]]) for r in own]
    return math.sqrt(sum(x**2 for x in ratios) / len(ratios))


def nearest_at(table: Rows, horizon_s: float) -> list[dict[str, Any]]:
    """Filters with the least misfit to the published baseline errors.

    Args:
        table: Result of `sweep`.
        horizon_s: Horizon.

    Returns:
        For each reference: the filter, its misfit, and its errors by group; empty without rows of the horizon.
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


# Turn of the largest error of a straight forecast, 1.26 times the path length.
_LARGEST_TURN_RAD = 4.085


def turn_error_m(way_m: float, turn_rad: float) -> float:
    """Error of a straight forecast of a person on an arc.

    With path length s = v T and turn theta = omega T, the forecast is s in the initial direction, and the person is at
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
    """Least turn for a given error of a straight forecast; inverse of `turn_error_m`.

    Args:
        way_m: Length of the arc, metres.
        error_m: Error, metres.

    Returns:
        The turn, radians; None if no turn has such an error.
    """
    if turn_error_m(way_m, _LARGEST_TURN_RAD) < error_m:
        return None
    return float(brentq(lambda turn: turn_error_m(way_m, turn) - error_m, 0.0, _LARGEST_TURN_RAD))


def turns_needed(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Measured turns of each group, and the constant turn that explains the published baseline error.

    Args:
        rows: Rows of `experiments.paper.frames.labelled`.

    Returns:
        One row per group: median speed; turn from one half second to the next (median and 95th percentile of the
        absolute angle over frames); published error of the baseline; and turn in half a second that would cause this
        error at the median speed (None if there is none).
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
