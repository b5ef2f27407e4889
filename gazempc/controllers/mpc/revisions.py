"""How the forecast was revised lately, and what further revision that lets expect."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from gazempc.types import FloatArray

# Revisions are taken over this long, and their squares averaged with this time constant.
WINDOW_S = 0.2
_AVERAGE_S = 0.1
# Squared revisions average 1 while the covariance is right. From the first number on they are no chance: the person
# does something that the forecast lags behind; from the second on this is sure.
_CHANCE, _SURE = 3.0, 8.0
# Then this share of the last revision comes once more.
_FURTHER = 0.25


class Revisions:
    """Watches what a forecast says of the same instant, earlier and now.

    An honest forecast is revised by as much as its variance shrinks while the instant comes nearer, and nobody can say
    which way. One that is revised by far more than that follows something it did not expect (a turn, a start) with a
    lag, and will be revised further in the same direction. What is to be expected is never more than the forecast's
    standard deviation.

    Args:
        period_s: Control period, seconds; a plan that is left out starts the watch anew.
    """

    def __init__(self, period_s: float) -> None:
        self._plans = max(1, round(WINDOW_S / period_s))
        self._elapsed_s = self._plans * period_s
        self._keep = math.exp(-period_s / _AVERAGE_S)
        self._earlier = deque[tuple[float, FloatArray]](maxlen=self._plans)
        self.reset()

    @property
    def plans(self) -> int:
        """The window, control periods."""
        return self._plans

    def reset(self) -> None:
        """Forget all earlier forecasts."""
        self._earlier.clear()
        self._mean_square = [0.0, 0.0]

    def expected_rad(self, start_s: float, angles_rad: FloatArray, deviations_rad: FloatArray) -> FloatArray:
        """Take in a forecast and say how it will be revised.

        Args:
            start_s: Time of the plan that it is made for, seconds.
            angles_rad: Pan and tilt that it says for one instant, and for one `WINDOW_S` later, shape (2, 2).
            deviations_rad: Their standard deviations, shape (2, 2).

        Returns:
            Expected further revision of the first instant's pan and tilt, shape (2,), radians.
        """
        whole = len(self._earlier) == self._plans
        before_s, before_rad = self._earlier[0] if whole else (-math.inf, angles_rad[0])
        self._earlier.append((start_s, angles_rad[1]))
        if not math.isclose(start_s - before_s, self._elapsed_s, abs_tol=1e-6):
            if whole:
                self.reset()
            return np.zeros(2)
        # One number at a time: on two of them numpy takes several times as long.
        further_rad = [0.0, 0.0]
        for axis, (now_rad, earlier_rad, sigma_rad, later_sigma_rad) in enumerate(
            zip(angles_rad[0].tolist(), before_rad.tolist(), *deviations_rad.tolist(), strict=True)
        ):
            variance = later_sigma_rad**2 - sigma_rad**2
            if not (math.isfinite(now_rad - earlier_rad) and 0.0 < variance < math.inf):
                continue
            # Pan may have changed to another turn of the circle meanwhile.
            revision_rad = math.remainder(now_rad - earlier_rad, math.tau)
            mean_square = self._keep * self._mean_square[axis] + (1.0 - self._keep) * revision_rad**2 / variance
            self._mean_square[axis] = mean_square
            sure = min(max((mean_square - _CHANCE) / (_SURE - _CHANCE), 0.0), 1.0)
            further_rad[axis] = min(max(_FURTHER * sure * revision_rad, -sigma_rad), sigma_rad)
        return np.array(further_rad)
