"""The turns that would explain the published errors: a straight forecast of a person on an arc."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import brentq

from experiments.paper.published import (
    HORIZON_S,
    PUBLISHED,
)

_GROUPS = {p.label: p.group for p in PUBLISHED}
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
        own = [r for r in rows if _GROUPS.get(r["group"]) == published.group and r.get("speed_m_s")]
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
