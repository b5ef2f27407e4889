"""Errors of a tracker along and across the line of sight, by maximum likelihood."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import minimize

from gazempc.identify.tracker.likelihood import ErrorModel, Stretches, likelihood
from gazempc.types import FloatArray

# Weak beliefs, as centre and s.d. of the logarithm. They bound parameters that the data do not determine; ten
# seconds of data outweigh them. A person who stands sways with about 0.02 m s^-1.5, one who walks moves with 1.
_ACCELERATION = (np.log(0.2), 1.5)
_WANDER_RATIO = (np.log(1.0), 1.5)  # to the white error
_CORRELATION_S = (np.log(1.0), 1.0)
_BOUNDS = {
    "acceleration": (1e-3, 30.0),
    "white": (1e-6, 1.0),
    "wander": (1e-6, 1.0),
    "correlation": (0.03, 20.0),
}
# Half of the likelihood ratio that two more parameters must bring: 1 % of tracks without wander show more by chance.
_WANDER_GAIN = 4.6
_STEP = 1e-3
_ROUNDS = 200


@dataclass(frozen=True)
class Known:
    """A value and how sure it is.

    Attributes:
        value: The estimate.
        sd: Its standard deviation.
    """

    value: float
    sd: float


@dataclass(frozen=True)
class GroupFit:
    """Errors of one group of axes, in the unit of its values.

    Attributes:
        white: Standard deviation of the white error.
        wander: Standard deviation of the wander; None where the data show none.
        correlation_s: Its correlation time, seconds; None likewise.
        acceleration: Of the person, m s^-1.5.
    """

    white: Known
    wander: Known | None
    correlation_s: Known | None
    acceleration: Known


@dataclass(frozen=True)
class _Layout:
    """Where each parameter stands in the vector of logarithms, for each group of axes."""

    groups: tuple[tuple[int, ...], ...]
    wanders: tuple[bool, ...]
    one_person: bool

    @property
    def names(self) -> list[tuple[str, int]]:
        names = [("acceleration", g) for g in range(1 if self.one_person else len(self.groups))]
        for g, wanders in enumerate(self.wanders):
            names.append(("white", g))
            if wanders:
                names += [("wander", g), ("correlation", g)]
        return names

    def model(self, theta: FloatArray) -> ErrorModel:
        """Parameters of G trials, `theta` of shape (G, P)."""
        at = {name: k for k, name in enumerate(self.names)}
        axes = sum(len(group) for group in self.groups)
        parts = {name: np.full((len(theta), axes), 1e-9) for name in _BOUNDS}
        parts["correlation"][:] = 1.0
        for g, group in enumerate(self.groups):
            for name, part in parts.items():
                key = (name, 0 if name == "acceleration" and self.one_person else g)
                if key in at:
                    part[:, list(group)] = np.exp(theta[:, at[key]])[:, None]
        return ErrorModel(parts["acceleration"], parts["white"], parts["wander"], parts["correlation"])

    def belief(self, theta: FloatArray) -> FloatArray:
        """Logarithm of the weak beliefs, shape (G,)."""
        names = self.names
        at = {name: k for k, name in enumerate(names)}
        total = np.zeros(len(theta))
        for k, (name, g) in enumerate(names):
            if name == "acceleration":
                centre, sd = _ACCELERATION
                total -= 0.5 * ((theta[:, k] - centre) / sd) ** 2
            elif name == "correlation":
                centre, sd = _CORRELATION_S
                total -= 0.5 * ((theta[:, k] - centre) / sd) ** 2
            elif name == "wander":
                centre, sd = _WANDER_RATIO
                total -= 0.5 * ((theta[:, k] - theta[:, at["white", g]] - centre) / sd) ** 2
        return total


def fit_errors(
    data: Stretches,
    groups: tuple[tuple[int, ...], ...],
    one_person: bool,
    white_start: FloatArray,
) -> tuple[tuple[GroupFit, ...], ErrorModel]:
    """Fit person, wander and white error.

    Args:
        data: Stretches of the track.
        groups: Axes that share their errors, such as ``((0,), (1, 2))`` for along and across.
        one_person: True where the person's acceleration is one for all groups (who stands still sways alike in all
            directions); False where each group has its own.
        white_start: First guess of the white error of each group.

    Returns:
        One fit a group, and the model in the form that `likelihood` takes.
    """
    layout = _Layout(groups, (True,) * len(groups), one_person)
    theta, log = _maximum(data, layout, white_start)
    for g in range(len(groups)):
        less = _Layout(groups, tuple(w and k != g for k, w in enumerate(layout.wanders)), one_person)
        theta_less, log_less = _maximum(data, less, white_start)
        if log - log_less < _WANDER_GAIN:
            layout, theta, log = less, theta_less, log_less
    sds = _spread(data, layout, theta)
    at = {name: k for k, name in enumerate(layout.names)}

    def known(name: str, g: int) -> Known:
        k = at[name, g]
        value = float(np.exp(theta[k]))
        return Known(value, value * float(sds[k]))

    fits = tuple(
        GroupFit(
            known("white", g),
            known("wander", g) if wanders else None,
            known("correlation", g) if wanders else None,
            known("acceleration", 0 if one_person else g),
        )
        for g, wanders in enumerate(layout.wanders)
    )
    return fits, layout.model(theta[None])


def _maximum(data: Stretches, layout: _Layout, white_start: FloatArray) -> tuple[FloatArray, float]:
    names = layout.names
    bounds = [tuple(np.log(_BOUNDS[name])) for name, _ in names]
    starts = {"acceleration": np.log(0.3), "correlation": np.log(0.5)}
    start = np.array([starts.get(name, np.log(white_start[g])) for name, g in names])
    steps = _STEP * np.vstack([np.zeros(len(names)), np.eye(len(names)), -np.eye(len(names))])

    def cost(theta: FloatArray) -> tuple[float, FloatArray]:
        values = _log_posterior(data, layout, theta + steps)
        n = len(names)
        return -values[0], -(values[1 : n + 1] - values[n + 1 :]) / (2.0 * _STEP)

    found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _ROUNDS})
    return np.asarray(found.x), -float(found.fun)


def _log_posterior(data: Stretches, layout: _Layout, theta: FloatArray) -> FloatArray:
    log = likelihood(data, layout.model(theta)).log
    return np.asarray(log.sum(axis=(1, 2)) + layout.belief(theta))


def _spread(data: Stretches, layout: _Layout, theta: FloatArray) -> FloatArray:
    """Standard deviations of the logarithms, shape (P,): the larger of two estimates, by curvature and by stretches."""
    n, h = len(theta), 0.03
    e = h * np.eye(n)
    points = [np.zeros(n), *e, *-e]
    pairs = list(combinations(range(n), 2))
    for i, j in pairs:
        points += [e[i] + e[j], e[i] - e[j], -e[i] + e[j], -e[i] - e[j]]
    trials = theta + np.array(points)
    model = layout.model(trials)
    each = likelihood(data, model).log.sum(axis=1)
    log = each.sum(axis=1) + layout.belief(trials)
    curvature = np.diag((log[1 : n + 1] - 2.0 * log[0] + log[n + 1 : 2 * n + 1]) / h**2)
    for k, (i, j) in enumerate(pairs):
        a, b, c, d = log[2 * n + 1 + 4 * k : 2 * n + 5 + 4 * k]
        curvature[i, j] = curvature[j, i] = (a - b - c + d) / (4.0 * h**2)
    inverse = np.linalg.pinv(-curvature, hermitian=True)
    slopes = (each[1 : n + 1] - each[n + 1 : 2 * n + 1]) / (2.0 * h)
    slopes = slopes - slopes.mean(axis=1, keepdims=True)
    between = inverse @ (slopes @ slopes.T) @ inverse
    return np.asarray(np.sqrt(np.maximum(np.clip(np.diag(inverse), 0.0, None), np.diag(between))))
