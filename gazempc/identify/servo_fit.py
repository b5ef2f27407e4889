"""Least squares with confidence intervals for correlated residuals, and the response of a servo with dead time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_toeplitz
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, lfilter
from scipy.special import stdtrit

from gazempc.types import FloatArray

# Two-sided 95 % of a normal distribution.
Z_95 = 1.959964


@dataclass(frozen=True)
class Fit:
    """Result of a fit with p parameters to n residuals.

    Attributes:
        values: Best parameters, shape (p,).
        covariance: Their covariance, shape (p, p).
        residual: Shape (n,).
    """

    values: FloatArray
    covariance: FloatArray
    residual: FloatArray


def fit(
    residual: Callable[[FloatArray], FloatArray],
    starts: Sequence[Sequence[float]],
    low: Sequence[float],
    high: Sequence[float],
    channels: int = 1,
) -> Fit:
    """Multi-start least squares.

    Args:
        residual: Maps parameters, shape (p,), to residuals in temporal order, shape (n,).
        starts: Initial values.
        low: Lower bounds.
        high: Upper bounds.
        channels: Number of consecutive residuals of the same time.

    Returns:
        The best fit.
    """
    results = [least_squares(residual, start, jac="3-point", bounds=(low, high)) for start in starts]
    best = min(results, key=lambda result: float(result.cost))
    return Fit(best.x, robust_covariance(np.asarray(best.jac), best.fun, channels), best.fun)


def robust_covariance(jacobian: FloatArray, residual: FloatArray, channels: int = 1) -> FloatArray:
    """Covariance of a least-squares estimate whose errors are correlated in time.

    The spectrum of the errors is modelled by an autoregression fitted to the residuals (den Haan & Levin 1997, "A
    practitioner's guide to robust covariance matrix estimation"). The formula for independent errors is a lower bound:
    spurious correlation must not reduce the covariance.

    Args:
        jacobian: Shape (n, p).
        residual: Shape (n,), in temporal order.
        channels: Number of consecutive residuals of the same time.

    Returns:
        Shape (p, p); `Z_95` standard deviations are half the 95 % interval.
    """
    n, p = jacobian.shape
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    spread = n / max(n - p, 1)
    # Decorrelate (whiten) the errors of one time.
    errors = residual.reshape(-1, channels)
    _, mixing = np.linalg.eigh(errors.T @ errors)
    rows = np.einsum("tcp,cd->dtp", jacobian.reshape(-1, channels, p), mixing)
    meat = sum(_of_stationary(row, error) for row, error in zip(rows, (errors @ mixing).T, strict=True))
    correlated = spread * inverse @ meat @ inverse
    independent = spread * inverse * float(residual @ residual) / n
    ratio = np.diag(independent) / np.maximum(np.diag(correlated), 1e-300)
    # Effective sample size of correlated errors, minus p degrees of freedom: Student's quantile.
    freedom = np.maximum(len(errors) * np.minimum(1.0, ratio) - p, 1.0)
    widening = (stdtrit(freedom, 0.975) / Z_95) ** 2 * (freedom + p) / freedom
    more = np.sqrt(np.maximum(1.0, ratio) * widening)
    return np.asarray(correlated * np.outer(more, more))


def _of_stationary(jacobian: FloatArray, error: FloatArray) -> FloatArray:
    """Covariance of ``jacobian.T @ error`` for errors with the spectrum of an autoregression, shape (p, p)."""
    count = len(error)
    # Order of the autoregression of residuals: white encoder noise plus slowly varying friction needs more than one.
    order = min(4, count // 8)
    # Zero padding to twice the length, against circular correlation.
    power = np.abs(np.fft.rfft(error, 2 * count)) ** 2
    autocovariance = np.fft.irfft(power)[: order + 1] / count
    if not autocovariance[0] > 0.0:
        return np.zeros((jacobian.shape[1],) * 2)
    weights = solve_toeplitz(autocovariance[:-1], autocovariance[1:]) if order else np.empty(0)
    innovation = autocovariance[0] - float(weights @ autocovariance[1:])
    spectrum = innovation / np.abs(np.fft.rfft(np.append(1.0, -weights), 2 * count)) ** 2
    spectrum[1:-1] *= 2.0  # the negative frequencies
    transformed = np.fft.rfft(jacobian, 2 * count, axis=0)
    products: FloatArray = np.einsum("f,fj,fk->jk", spectrum, transformed.conj(), transformed).real
    return products / (2 * count)


class ServoModel:
    """Responses of ``q'' = wn^2 (u(t - d) - q) - 2 zeta wn q'`` to one axis's commands, at the times of the readings.

    The servo without delay is simulated exactly, with zero-order hold, on a grid of about 2 ms. A cubic spline is
    evaluated at time - d, so d is continuous. The joint is initially at rest at the first command.

    Args:
        command_time_s: Send times of the commands, shape (K,), increasing, seconds.
        command_rad: Commands, each held until the next, shape (K,), radians.
        time_s: Measurement times of the joint, shape (N,), increasing, seconds.
    """

    def __init__(self, command_time_s: FloatArray, command_rad: FloatArray, time_s: FloatArray) -> None:
        period_s = float(np.median(np.diff(command_time_s)))
        # An integer fraction of the period: regular command times are on the grid.
        self._step_s = period_s / np.ceil(period_s / 0.002 - 1e-9)
        self._first_rad = float(command_rad[0])
        self._since_s = time_s - command_time_s[0]
        self._from_first_s = time_s - time_s[0]
        # Extension of the grid beyond the last reading, for slightly negative dead times during the fit.
        cells = int(np.ceil((self._since_s[-1] + 0.2) / self._step_s)) + 2
        self._grid_s = np.arange(cells + 1) * self._step_s
        # Means over the cells from the integral of the held command: exact also for irregular command times.
        knots_s = np.append(command_time_s - command_time_s[0], max(self._grid_s[-1], self._since_s[-1]) + period_s)
        integral = np.concatenate([[0.0], np.cumsum(np.diff(knots_s) * (command_rad - command_rad[0]))])
        cells_rad = np.diff(np.interp(self._grid_s, knots_s, integral)) / self._step_s
        self._cells_rad: FloatArray = np.append(cells_rad, cells_rad[-1])

    def motion(self, natural_frequency_rad_s: float, damping_ratio: float) -> CubicSpline:
        """Motion without dead time from rest at 0, radians by seconds since the first command."""
        numerator, denominator = self._discrete(natural_frequency_rad_s, damping_ratio)
        return CubicSpline(self._grid_s, lfilter(numerator, denominator, self._cells_rad))

    def delayed(self, motion: CubicSpline, dead_time_s: float) -> FloatArray:
        """The motion a dead time later, at the times of the readings, shape (N,), radians."""
        at_s = np.clip(self._since_s - dead_time_s, 0.0, self._grid_s[-1])
        return np.asarray(self._first_rad + motion(at_s))

    def free(self, natural_frequency_rad_s: float, damping_ratio: float) -> FloatArray:
        """Basis of the free responses since the first reading, shape (N, 2)."""
        _, denominator = self._discrete(natural_frequency_rad_s, damping_ratio)
        responses = lfilter([1.0], denominator, np.eye(self._grid_s.size, 2), axis=0)
        return np.asarray(CubicSpline(self._grid_s, responses)(self._from_first_s))

    def _discrete(self, wn: float, zeta: float) -> tuple[FloatArray, FloatArray]:
        system = np.array([wn**2]), np.array([1.0, 2.0 * zeta * wn, wn**2])
        numerator, denominator, *_ = cont2discrete(system, self._step_s, method="zoh")
        return np.ravel(numerator), np.asarray(denominator)
