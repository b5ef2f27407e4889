"""Which detection is of whom: a gate around each expected position, and the assignment of least cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from gazempc.people.motion import Motion
from gazempc.types import BoolArray, FloatArray
from predictors.gate import GATE_D2, allowance_m

# What a tracker's names are worth beside distances in standard deviations, as twice the logarithm of the odds. A name
# that agrees is right 400 times as often as one that differs. People whose gates do not overlap never swap by it.
_OTHER_NAME_COST, _NO_NAME_COST = 12.0, 6.0
_NEVER = 1e9


def assign(
    expected: Motion,
    unseen_s: FloatArray,
    track_names: Sequence[str | None],
    measured_m: FloatArray,
    noise_m2: FloatArray,
    names: Sequence[str | None],
) -> list[tuple[int, int]]:
    """Assign detections of one instant to people.

    The cost is minus twice the log likelihood of the detection, and something for a name that differs.

    Args:
        expected: The people's motion at this instant.
        unseen_s: For how long nobody has seen each of them, shape (N,), seconds.
        track_names: What the tracker called each of them last.
        measured_m: Detections, shape (D, 3), metres.
        noise_m2: Covariances of their errors, shape (D, 3, 3).
        names: What the tracker calls them now.

    Returns:
        Pairs of person and detection; each is in one pair at most.
    """
    if not len(track_names) or not len(names):
        return []
    spread = expected.pp_m2[:, None] + noise_m2
    spread = spread + (allowance_m(unseen_s) ** 2)[:, None, None, None] * np.eye(3)
    apart = measured_m - expected.position_m[:, None]
    d2 = (apart[:, :, None, :] @ np.linalg.inv(spread) @ apart[:, :, :, None])[:, :, 0, 0]
    near = d2 <= GATE_D2  # a NaN is not near
    cost = np.where(near, d2 + np.log(np.linalg.det(spread)) + _name_cost(track_names, names), _NEVER)
    rows, columns = linear_sum_assignment(cost)
    return [(row, column) for row, column in zip(rows.tolist(), columns.tolist(), strict=True) if near[row, column]]


def _name_cost(track_names: Sequence[str | None], names: Sequence[str | None]) -> FloatArray:
    ours, theirs = np.array(track_names, dtype=object), np.array(names, dtype=object)
    same: BoolArray = np.asarray(ours[:, None] == theirs, dtype=np.bool_)
    unknown: BoolArray = np.asarray(ours == None)[:, None] | np.asarray(theirs == None)  # noqa: E711  (elementwise)
    return np.where(unknown, _NO_NAME_COST, np.where(same, 0.0, _OTHER_NAME_COST))
