"""Interpolation of departures and standard deviations between the knots."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from predictors.types import FloatArray
from predictors.walker.network import KNOTS_S

_LAST_KNOT_S = float(KNOTS_S[-1])
# Growth exponent of the error beyond the last knot: the velocity as a random walk.
_GROWTH = 1.5
_SPLINE = CubicSpline(KNOTS_S, np.eye(KNOTS_S.size))
_END_SLOPE = (_SPLINE(KNOTS_S[-1]) - _SPLINE(KNOTS_S[-2])) / (KNOTS_S[-1] - KNOTS_S[-2])
# Spline and linear weights of the knots, tabulated every millisecond: a lookup takes a tenth of the time of a spline
# evaluation; the error of linear interpolation between entries is below 1e-5.
_TABLE_STEP_S = 1e-3
_TABLE_S = np.arange(round(KNOTS_S[-1] / _TABLE_STEP_S) + 2) * _TABLE_STEP_S
_TABLE = np.hstack(
    [_SPLINE(_TABLE_S), np.stack([np.interp(_TABLE_S, KNOTS_S, column) for column in np.eye(KNOTS_S.size)], axis=1)]
)
_TABLE_CHANGE = np.diff(_TABLE, axis=0)


class BetweenKnots:
    """Departures and standard deviations at any horizon.

    Args:
        departure_m: Departures at the knots, shape (knots, 3).
        spread_m: Standard deviations at the knots, shape (knots, columns), as from `WalkerModel.spread_m`.
    """

    def __init__(self, departure_m: FloatArray, spread_m: FloatArray) -> None:
        # Block matrix: one product with both sets of weights gives departures and spread.
        self._values = np.zeros((2 * KNOTS_S.size, 3 + spread_m.shape[1]))
        self._values[: KNOTS_S.size, :3] = departure_m
        np.maximum.accumulate(spread_m, axis=0, out=self._values[KNOTS_S.size :, 3:])

    def __call__(self, tau_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Interpolate at the given horizons.

        Args:
            tau_s: Horizons, shape (H,), seconds.

        Returns:
            Departures, shape (H, 3): cubic spline between the knots, constant before the first, linear after the last.
            Standard deviations, shape (H, columns): linear between the knots, nondecreasing in the horizon, growing
            with its power 1.5 after the last; symmetric in past and future.
        """
        past = bool(np.minimum.reduce(tau_s, initial=0.0) < 0.0)
        away_s = np.abs(tau_s) if past else tau_s
        beyond = bool(np.maximum.reduce(away_s, initial=0.0) > _LAST_KNOT_S)
        both = _weights(np.maximum(tau_s, 0.0) if past else tau_s) @ self._values
        departure, spread = both[:, :3], both[:, 3:]
        if past:
            spread = _weights(away_s)[:, KNOTS_S.size :] @ self._values[KNOTS_S.size :, 3:]
        if beyond:
            slope_m_s = _END_SLOPE @ self._values[: KNOTS_S.size, :3]
            departure = departure + np.maximum(tau_s - _LAST_KNOT_S, 0.0)[:, None] * slope_m_s
            spread = spread * np.maximum(away_s / _LAST_KNOT_S, 1.0)[:, None] ** _GROWTH
        return departure, spread


def _weights(tau_s: FloatArray) -> FloatArray:
    at = np.minimum(tau_s, _LAST_KNOT_S) / _TABLE_STEP_S
    row = at.astype(np.intp)
    weights: FloatArray = _TABLE_CHANGE.take(row, axis=0)
    weights *= (at - row)[:, None]
    weights += _TABLE.take(row, axis=0)
    return weights
