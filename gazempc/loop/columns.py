"""Rows of numbers appended one at a time, in an array that grows in amortised constant time, and its columns."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable

import numpy as np

from gazempc.types import FloatArray, JointState


def columns(rows: array[float], *shapes: tuple[int, ...]) -> list[FloatArray]:
    """Columns of a table.

    Args:
        rows: The rows, one after the other.
        shapes: Shape of a row's part in each column, such as () for a number.

    Returns:
        One contiguous array a column, with rows along the first axis.
    """
    sizes = [math.prod(shape) for shape in shapes]
    parts = np.split(np.array(rows).reshape(-1, sum(sizes)), np.cumsum(sizes)[:-1], axis=1)
    return [np.ascontiguousarray(part).reshape(-1, *shape) for part, shape in zip(parts, shapes, strict=True)]


def reading(state: JointState | None, joints: int) -> Iterable[float]:
    """A reading of N joints as a row: time, N positions, N velocities; NaN for a missing one."""
    if state is None:
        return (math.nan,) * (1 + 2 * joints)
    return state.time_s, *state.position_rad.tolist(), *state.velocity_rad_s.tolist()


class JointColumns:
    """Joint readings, one row each.

    Args:
        joints: N, the number of joints.
        states: The first rows; None for missing readings.
    """

    def __init__(self, joints: int, states: Iterable[JointState | None] = ()) -> None:
        self._joints, self._rows = joints, array("d")
        for state in states:
            self.append(state)

    def __len__(self) -> int:
        return len(self._rows) // (1 + 2 * self._joints)

    def append(self, state: JointState | None) -> None:
        """Add a row."""
        self._rows.extend(reading(state, self._joints))

    def arrays(self) -> list[FloatArray]:
        """Times, shape (M,), positions and velocities, shape (M, N); NaN for missing readings."""
        return columns(self._rows, (), (self._joints,), (self._joints,))
