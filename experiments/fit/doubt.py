"""How far models err on people whom they have not seen; from that comes the uncertainty that they state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from experiments.fit.examples import Examples
from experiments.fit.spread import calibrate, fit_spread
from gazempc.types import FloatArray
from predictors.walker.network import WalkerModel


@dataclass(frozen=True)
class Found:
    """How far forecasts erred."""

    doubt: FloatArray
    error_m: FloatArray
    weight: FloatArray

    @classmethod
    def by(cls, model: WalkerModel, part: Examples) -> Found:
        """Errors of a model on examples."""
        departure, doubt = model.answer(part.network.astype(np.float64), part.spread.astype(np.float64))
        return cls(doubt, departure - part.departure_m, part.weight.astype(np.float64))

    @classmethod
    def join(cls, parts: Sequence[Found | None]) -> Found:
        """All errors in one table; None is left out."""
        known = [p for p in parts if p is not None]
        return cls(*(np.concatenate([getattr(p, f.name) for p in known]) for f in fields(cls)))


def errors_on_left_out(
    left_out: Mapping[str, WalkerModel], people: Sequence[str], scoring: Sequence[Sequence[Examples | None]]
) -> list[list[Found | None]]:
    """Errors on each recording by the model that has not seen who walks in it.

    Args:
        left_out: Model by the person that it has not seen.
        people: Who walks in each recording.
        scoring: Examples of each recording: as it is, and bent, or None for one that is not bent.

    Returns:
        The errors, for each recording as it is and bent.
    """
    return [
        [None if part is None else Found.by(left_out[person], part) for part in parts]
        for person, parts in zip(people, scoring, strict=True)
    ]


def fit_doubt(found: Sequence[Sequence[Found | None]]) -> FloatArray:
    """Fit the stated uncertainty to errors.

    Args:
        found: Errors on each recording as it is, and bent.

    Returns:
        ``log_spread`` of a `WalkerModel`.
    """
    plain = Found.join([parts[0] for parts in found])
    everything = Found.join([part for parts in found for part in parts])
    log_spread = fit_spread(everything.doubt, everything.error_m, everything.weight)
    return calibrate(log_spread, plain.doubt, plain.error_m)
