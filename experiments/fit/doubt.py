"""How far models err on people whom they have not seen; from that comes the uncertainty that they state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from experiments.fit.examples import Examples
from experiments.fit.spread import Spread, fit_spread
from gazempc.types import FloatArray
from predictors.walker.network import RegimeMotion, WalkerModel


@dataclass(frozen=True)
class Found:
    """How far forecasts erred."""

    doubt: FloatArray
    noise_m: FloatArray
    error_m: FloatArray
    weight: FloatArray

    @classmethod
    def by(cls, model: WalkerModel, part: Examples) -> Found:
        """Errors of a model on examples."""
        motion = RegimeMotion(part.line_m_s.astype(np.float64), part.places_m.astype(np.float64))
        departure, doubt = model.answer(part.network.astype(np.float64), part.spread.astype(np.float64), motion)
        noise_m, weight = part.noise_m.astype(np.float64), part.weight.astype(np.float64)
        return cls(doubt, noise_m, departure - part.departure_m, weight)

    @classmethod
    def join(cls, parts: Sequence[Found]) -> Found:
        """All errors in one table."""
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))


def errors_on_left_out(
    left_out: Mapping[str, WalkerModel], people: Sequence[str], scoring: Sequence[Examples]
) -> list[Found]:
    """Errors on each recording by the model that has not seen the person in it.

    Args:
        left_out: Model by the person that it has not seen.
        people: The person in each recording.
        scoring: Examples of each recording.

    Returns:
        The errors, for each recording.
    """
    return [Found.by(left_out[person], part) for person, part in zip(people, scoring, strict=True)]


def fit_doubt(found: Sequence[Found]) -> Spread:
    """Fit the stated uncertainty to errors.

    Args:
        found: Errors on each recording.

    Returns:
        The uncertainty's part of a `WalkerModel`.
    """
    everything = Found.join(found)
    return fit_spread(everything.doubt, everything.noise_m, everything.error_m, everything.weight)
