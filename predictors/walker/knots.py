"""Horizons of `Walker`'s model, the knots, and interpolation between them."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from predictors.types import FloatArray

# Horizons of the networks' departures, seconds; a cubic spline interpolates between them.
KNOTS_S = np.array([0.0, 0.125, 0.25, 0.375, 0.5, 0.75, 1.0, 1.5])
# Growth exponent of the error beyond the last knot: the velocity as a random walk.
_GROWTH = 1.5
# Polynomial coefficients of each interval, and of the one after the last knot, as linear functions of the values at the
# knots, shape (4, knots, knots): cubic spline with a linear continuation, and linear interpolation.
_SPLINE, _LINEAR = np.zeros((2, 4, KNOTS_S.size, KNOTS_S.size))
_SPLINE[:, :-1] = CubicSpline(KNOTS_S, np.eye(KNOTS_S.size)).c
_LINEAR[2, :-1] = np.diff(np.eye(KNOTS_S.size), axis=0) / np.diff(KNOTS_S)[:, None]
_SPLINE[3, -1], _LINEAR[3] = np.eye(KNOTS_S.size)[-1], np.eye(KNOTS_S.size)
_SPLINE[2, -1] = np.diff(KNOTS_S)[-1] ** np.arange(2, -1, -1) @ _SPLINE[:3, -2]
_BREAKS_S = np.append(KNOTS_S, np.inf)


class BetweenKnots:
    """Departures and standard deviations at any horizon.

    Args:
        departure_m: Departures at the knots, shape (knots, 3).
        spread_m: Standard deviations at the knots, shape (knots, columns), as from `WalkerModel.spread_m`.
    """

    def __init__(self, departure_m: FloatArray, spread_m: FloatArray) -> None:
        of_spread = _LINEAR @ np.maximum.accumulate(spread_m, axis=0)
        coefficients = np.concatenate([_SPLINE @ departure_m, of_spread], axis=2)
        self._values = PPoly.construct_fast(coefficients, _BREAKS_S)  # without validation, which takes longer

    def __call__(self, tau_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Interpolate at the given horizons.

        Args:
            tau_s: Horizons, shape (H,), seconds.

        Returns:
            Departures, shape (H, 3): cubic spline between the knots, constant before the first, linear after the last.
            Standard deviations, shape (H, columns): linear between the knots, nondecreasing in the horizon, growing
            with its power 1.5 after the last; symmetric in past and future.
        """
        away_s = np.abs(tau_s)
        both = self._values(away_s)
        growth = np.maximum(away_s / KNOTS_S[-1], 1.0)[:, None] ** _GROWTH
        return np.where(tau_s[:, None] < 0.0, self._values.c[3, 0, :3], both[:, :3]), growth * both[:, 3:]
