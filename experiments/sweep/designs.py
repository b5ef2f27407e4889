"""Points of a sweep's designs."""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.sweep.names import setting_fields
from experiments.sweep.spec import Case, Range
from gazempc.types import FloatArray

Point = dict[str, Any]


def design_points(case: Case, seed: int) -> list[Point]:
    """Points of a grid, random or sobol design.

    Args:
        case: A complete case (`experiments.sweep.spec.SweepSpec.all_cases`).
        seed: Seed of the design; the case's name is mixed in.

    Returns:
        The values that vary, by dotted name; the same arguments give the same points, and a larger ``n`` only adds
        points.
    """
    if case.design == "grid":
        return [dict(zip(case.vary, values, strict=True)) for values in itertools.product(*case.vary.values())]
    rng = np.random.default_rng(case_seed(case, seed))
    size = (case.n or 0, len(case.vary))
    if case.design == "random":
        draws = rng.random(size)
    else:
        from scipy.stats import qmc  # noqa: PLC0415  (slow to import, and no other design needs it)

        # Drawn in powers of two, for which the sequence is balanced, and cut to n.
        draws = qmc.Sobol(size[1], rng=rng).random_base2(math.ceil(math.log2(max(size[0], 1))))[: size[0]]
    return [point_at(case.vary, row) for row in draws]


def case_seed(case: Case, seed: int) -> list[int]:
    """Seed of a case's design."""
    return [seed, zlib.crc32(case.name.encode())]


def point_at(vary: Mapping[str, Any], draw: FloatArray) -> Point:
    """The point at a place in the unit cube.

    Args:
        vary: What each setting may be.
        draw: Place, shape (len(vary),), each in [0, 1).

    Returns:
        Value by dotted name.
    """
    return {name: _value(name, entry, float(u)) for (name, entry), u in zip(vary.items(), draw, strict=True)}


def is_whole(name: str, entry: Range) -> bool:
    """True if a range has whole numbers only."""
    return entry.integer or setting_fields()[name].annotation is int


def _value(name: str, entry: Any, u: float) -> Any:
    if not isinstance(entry, Range):
        return entry[int(u * len(entry))]
    whole = is_whole(name, entry)
    # Every whole number gets an equal share, the ends too.
    low, high = (entry.low, entry.high + 1.0) if whole else (entry.low, entry.high)
    value = low * (high / low) ** u if entry.log else low + u * (high - low)
    return min(math.floor(value), int(entry.high)) if whole else min(value, entry.high)
