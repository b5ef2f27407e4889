"""Errors over the time constant of the position filter, and the one whose errors are nearest to the published ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.paper.frames import HORIZONS_S, Against, Frames, filter_time_s, frames_of
from experiments.paper.published import HORIZON_S, PUBLISHED
from experiments.paper.validation import exact_weight

# The default of `predictors.ConstantVelocity`, which errs least on walking people.
TUNED_TIME_S = round(filter_time_s(0.05), 4)
SLOW_TIME_S = 1.0
FILTER_TIMES_S = (0.05, TUNED_TIME_S, 0.15, 0.24, 0.4, 0.7, SLOW_TIME_S, 1.4, 2.0)
Rows = Sequence[dict[str, Any]]
AGAINST: tuple[Against, ...] = ("filtered", "true")


@dataclass(frozen=True)
class FilterRow:
    """Mean errors of one group with one filter, measured in one way.

    Attributes:
        filter_time_s: Time constant of the position filter.
        against: What the forecast is compared with.
        horizon_s: How far ahead.
        group: R12, R34 or R56.
        baseline_mm: Mean over frames without the rule.
        weight: The w that is best for all groups together, with this filter.
        error_at_weight_mm: Mean over the group's frames with that w.
    """

    filter_time_s: float
    against: Against
    horizon_s: float
    group: str
    baseline_mm: float
    weight: float
    error_at_weight_mm: float


def sweep(rows_by_time: Mapping[float, Sequence[dict[str, Any]]]) -> list[FilterRow]:
    """Sweep the filter's time constant against w.

    Args:
        rows_by_time: For each time constant the rows of `experiments.paper.frames.labelled`.

    Returns:
        One row for each time constant, way to measure, horizon and group.
    """
    table = []
    for time_s, rows in rows_by_time.items():
        for horizon_s in HORIZONS_S:
            for against in AGAINST:
                videos = frames_of(rows, against, horizon_s=horizon_s)
                if not videos:
                    continue
                weight = exact_weight(videos)
                for group in groups_in(videos):
                    own = [v for v in videos if v.group == group]
                    errors_mm = mean_mm(own, 0.0), weight, mean_mm(own, weight)
                    table.append(FilterRow(time_s, against, horizon_s, group, *errors_mm))
    return table


def groups_in(videos: Sequence[Frames]) -> list[str]:
    """Codes of the groups that have videos, in the paper's order."""
    found = {v.group for v in videos}
    return [p.group for p in PUBLISHED if p.group in found]


def mean_mm(videos: Sequence[Frames], weight: float) -> float:
    """Mean error over all frames of some videos, mm."""
    return float(np.concatenate([v.error_mm(weight) for v in videos]).mean())


def closest_time_s(table: Sequence[FilterRow], against: Against, horizon_s: float = HORIZON_S) -> float:
    """The time constant whose baseline errors are nearest to the published ones.

    Args:
        table: As made by `sweep`.
        against: Way to measure.
        horizon_s: Horizon.

    Returns:
        The time constant with the least root mean square of the errors' log ratios.
    """
    return min(dict.fromkeys(r.filter_time_s for r in table), key=lambda t: misfit(table, t, against, horizon_s))


def misfit(table: Sequence[FilterRow], time_s: float, against: Against, horizon_s: float = HORIZON_S) -> float:
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
    ratios = [
        math.log(r.baseline_mm / published[r.group])
        for r in table
        if (r.filter_time_s, r.against, r.horizon_s) == (time_s, against, horizon_s)
    ]
    return math.sqrt(sum(x**2 for x in ratios) / len(ratios))


def nearest_at(table: Sequence[FilterRow], horizon_s: float) -> list[dict[str, Any]]:
    """Filters whose baseline errors are nearest to the published ones.

    Args:
        table: As made by `sweep`.
        horizon_s: Horizon.

    Returns:
        For each way to measure the filter, its misfit, and its errors by group; empty without rows of the horizon.
    """
    nearest: list[dict[str, Any]] = []
    table = [r for r in table if r.horizon_s == horizon_s]
    if not table:
        return nearest
    for against in AGAINST:
        time_s = closest_time_s(table, against, horizon_s)
        own = [r for r in table if (r.filter_time_s, r.against, r.horizon_s) == (time_s, against, horizon_s)]
        nearest.append(
            {
                "against": against,
                "filter_time_s": time_s,
                "misfit": misfit(table, time_s, against, horizon_s),
                "baseline_mm": {r.group: r.baseline_mm for r in own},
                "proposed_mm": {r.group: r.error_at_weight_mm for r in own},
                "weight": own[0].weight,
            }
        )
    return nearest


def known_groups(rows: Rows) -> list[str]:
    """Codes of the groups that the rows have frames of."""
    return groups_in(frames_of(rows))
