"""Column store for rows appended one at a time: packed in blocks, to bound the time of each append."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from gazempc.types import FloatArray, JointState

Row = TypeVar("Row")
Arrays = tuple[NDArray[Any], ...]
# Rows a block: packing takes a tenth of a tick. Packing or freeing the rows of minutes at once takes twenty ticks.
_PIECE = 128
_EMPTY = np.empty(0)


class PackedRows(Generic[Row]):
    """A table that grows by rows.

    Args:
        pack: Converts rows to arrays, one a column, with rows along the first axis.
    """

    def __init__(self, pack: Callable[[list[Row]], Arrays]) -> None:
        self._pack = pack
        self._pieces: list[Arrays] = []
        self._rows: list[Row] = []

    def __len__(self) -> int:
        return _PIECE * len(self._pieces) + len(self._rows)

    def append(self, row: Row) -> None:
        """Add a row."""
        self._rows.append(row)
        if len(self._rows) == _PIECE:
            self._pieces.append(self._pack(self._rows))
            self._rows = []

    def arrays(self) -> Arrays:
        """All rows as columns."""
        last = [self._pack(self._rows)] if self._rows or not self._pieces else []
        return tuple(np.concatenate(parts) for parts in zip(*self._pieces, *last, strict=True))


class JointColumns(PackedRows[JointState | None]):
    """Joint readings: times, shape (M,), positions and velocities, shape (M, N); NaN for missing ones.

    Args:
        joints: N, the number of joints.
        states: The first rows.
    """

    def __init__(self, joints: int, states: Iterable[JointState | None] = ()) -> None:
        super().__init__(lambda rows: pack_states(rows, joints))
        for state in states:
            self.append(state)


def pack_states(states: Sequence[JointState | None], joints: int) -> Arrays:
    """Readings as arrays.

    Args:
        states: The readings; None for missing ones.
        joints: N, the number of joints.

    Returns:
        Times, shape (M,), positions and velocities, shape (M, N).
    """
    nowhere = np.full(joints, np.nan)
    return (
        np.array([np.nan if s is None else s.time_s for s in states]),
        pack_rows([nowhere if s is None else s.position_rad for s in states], joints),
        pack_rows([nowhere if s is None else s.velocity_rad_s for s in states], joints),
    )


def pack_rows(rows: Sequence[FloatArray], columns: int) -> FloatArray:
    """Arrays of one length as rows, shape (M, columns)."""
    # Concatenation takes a fifth of the time of an array of arrays.
    return np.concatenate([_EMPTY, *rows]).reshape(-1, columns)
