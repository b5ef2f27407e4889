"""White error, wander and jumps of a track, by maximum likelihood.

Each axis by itself is position and velocity driven by white acceleration (the person), plus an Ornstein-Uhlenbeck
process (the tracker's wander), plus white noise. A Kalman filter gives the likelihood at the true times of the frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import minimize

from gazempc.types import BoolArray, FloatArray, IntArray

Groups = tuple[tuple[int, ...], ...]
# Initial variance of the position in each stretch: (1 rad)^2, or the square of a share of 1; and initial speed.
_START_VARIANCE = 1.0
_START_SPEED_M_S = 1.0
# After a longer gap, position and velocity have their initial variance again.
_RESTART_S = 1.0
# Weak priors, as centre and s.d. of the logarithm. They bound parameters that the data do not determine; ten seconds of
# data outweigh them. A person who stands sways with about 0.02 m s^-1.5, one who walks moves with 1.
_PRIORS = {
    "acceleration": (np.log(0.2), 1.5),
    "wander": (np.log(1.0), 1.5),  # of its ratio to the white error
    "correlation": (np.log(1.0), 1.0),
}
_BOUNDS = {
    "acceleration": (1e-3, 30.0),
    "white": (1e-6, 1.0),
    "wander": (1e-6, 1.0),
    "correlation": (0.03, 20.0),
}
# A wander has two parameters and must raise the log-likelihood by half of the 99 % quantile of χ² with 2 degrees of
# freedom: in 1 % of tracks without wander it does so by chance.
_WANDER_GAIN = 4.6
_STEP, _CURVATURE_STEP = 1e-3, 0.03  # of finite differences of the logarithms
_ITERATIONS = 200
# A normal innovation is larger once in 150,000 frames and axes.
_GATE = 4.5
_ROUNDS = 3
# Standard deviation of a normal distribution over its median absolute deviation.
_NORMAL = 1.4826
# The variance of third differences of white noise is this many times its own. If the fitted white error is below this
# share of theirs, the person's motion or the tracker's smoothing hides it.
_THIRD_DIFFERENCES, _HIDDEN = 20.0, 0.4
# Each frame of a jump, also the first, is at least this share of its size away. A person starts to move more slowly.
_STEP_SHARE = 0.5
# No tracker has less error; the fit of a logarithm needs a positive start.
_LEAST = 1e-5


@dataclass(frozen=True)
class Known:
    """A value and its standard deviation."""

    value: float
    sd: float


@dataclass(frozen=True)
class GroupFit:
    """Errors of one group of axes, in the unit of its values.

    Attributes:
        white: Standard deviation of the white error.
        wander: Standard deviation of the wander; None where the data show none.
        correlation_s: Its correlation time, seconds; None likewise.
        hidden: Whether the white error is an upper bound: the person's motion hides it, or the tracker smooths it away.
    """

    white: Known
    wander: Known | None
    correlation_s: Known | None
    hidden: bool = False


@dataclass(frozen=True)
class TrackJumps:
    """Jumps of a track: frames far from the position interpolated between the frames before and after.

    Attributes:
        durations_s: Of each, shape (K,), seconds; 0 for a single frame.
        sizes: Root mean square of each on each axis, in the unit of the values, shape (K, A).
    """

    durations_s: FloatArray
    sizes: FloatArray


@dataclass(frozen=True)
class Stretches:
    """Pieces of a track, padded to one length.

    Attributes:
        intervals_s: Time since the frame before, shape (F, B), seconds; 0 in the first frame and in the padding.
        values: Measured values on each axis, shape (F, A, B).
        used: Frames that count, shape (F, B); False in the padding and in frames that are left out.
        scales_m: Metres of one unit of `values`, shape (B,).
    """

    intervals_s: FloatArray
    values: FloatArray
    used: BoolArray
    scales_m: FloatArray

    @property
    def duration_s(self) -> float:
        """Sum of the intervals of all frames that count."""
        return float(self.intervals_s[self.used].sum())


@dataclass(frozen=True)
class ErrorModel:
    """Parameters of the process for G trials and A axes, each of shape (G, A).

    Attributes:
        acceleration: Root spectral density of the person's acceleration, m s^-1.5.
        white: Standard deviation of the white error, in the unit of the values.
        wander: Standard deviation of the wander, in the unit of the values.
        correlation_s: Correlation time of the wander, seconds.
    """

    acceleration: FloatArray
    white: FloatArray
    wander: FloatArray
    correlation_s: FloatArray


@dataclass(frozen=True)
class Likelihood:
    """Output of the filter.

    Attributes:
        log: Log-likelihood of each trial, axis and stretch, shape (G, A, B).
        normalised: Innovation over its standard deviation, shape (F, A, B), of the last trial; NaN in frames that do
            not count.
    """

    log: FloatArray
    normalised: FloatArray


def measure_errors(
    data: Stretches, groups: Groups, one_person: bool, tell: Callable[[float], None]
) -> tuple[tuple[GroupFit, ...], TrackJumps]:
    """Fit errors, leave jumps out, and fit again.

    Args:
        data: Stretches of the track.
        groups: Axes that share their errors, such as ``((0,), (1, 2))`` for along and across.
        one_person: True where the person's acceleration is one for all groups (who stands still sways alike in all
            directions); False where each group has its own.
        tell: Called with the share that is done, 0 to 1.

    Returns:
        One fit a group, and the jumps that the fits leave out.
    """
    rough = np.array([_third_differences(data, group) for group in groups])
    start, used = rough, data.used
    for k in range(_ROUNDS):
        tell(k / _ROUNDS)
        fits, model = _fit(replace(data, used=used), groups, one_person, start)
        sizes = np.abs(np.nan_to_num(likelihood(data, model, _GATE).normalised)).max(axis=1)
        calm = data.used & ~_jumps_in(data, data.used & (sizes > _GATE))
        start = np.maximum([fit.white.value for fit in fits], _LEAST)
        if (calm == used).all():
            break
        used = calm
    bounded = tuple(
        replace(fit, white=Known(float(most), 0.0), hidden=True)
        if fit.wander is None and fit.white.value < _HIDDEN * most
        else fit
        for fit, most in zip(fits, rough, strict=True)
    )
    return bounded, _jumps(data, used)


def likelihood(data: Stretches, model: ErrorModel, gate: float = np.inf) -> Likelihood:
    """Filter all stretches with all trials at once.

    After a second without a frame that was used, the filter starts anew at the next one.

    Args:
        data: F frames of B stretches on A axes.
        model: G trials.
        gate: A frame whose innovation is larger than so many standard deviations on any axis is not used.

    Returns:
        Likelihood and innovations.
    """
    frames, axes, count = data.values.shape
    trials = model.white.shape[0]
    shape = (trials, axes, count)
    q = (model.acceleration[..., None] / data.scales_m) ** 2
    r, w2 = model.white[..., None] ** 2, model.wander[..., None] ** 2
    # Transitions and process noise depend on the intervals only: one array operation for all frames.
    steps_s = data.intervals_s[:, None, None, :]
    decays = np.exp(-steps_s / model.correlation_s[..., None])
    squares = decays**2
    added_xx, added_xv, added_vv = q * steps_s**3 / 3.0, q * steps_s**2 / 2.0, q * steps_s
    added_ww = w2 * (1.0 - squares)
    start_v = np.broadcast_to((_START_SPEED_M_S / data.scales_m) ** 2, shape)
    x = np.broadcast_to(data.values[0], shape).copy()
    v, w = np.zeros(shape), np.zeros(shape)
    pxx, pxv, pxw = np.full(shape, _START_VARIANCE), np.zeros(shape), np.zeros(shape)
    pvv, pvw, pww = start_v.copy(), np.zeros(shape), np.broadcast_to(w2, shape).copy()
    innovations, variances = np.zeros((frames, *shape)), np.ones((frames, *shape))
    uses = np.zeros((frames, count), dtype=bool)
    unseen_s = np.zeros(count)
    for k in range(frames):
        dt, decay = data.intervals_s[k], decays[k]
        unseen_s = unseen_s + dt
        x = x + v * dt
        w = w * decay
        pxx = pxx + dt * (2.0 * pxv + dt * pvv) + added_xx[k]
        pxv = pxv + dt * pvv + added_xv[k]
        pxw = (pxw + dt * pvw) * decay
        pvv = pvv + added_vv[k]
        pvw = pvw * decay
        pww = pww * squares[k] + added_ww[k]
        lost = unseen_s > _RESTART_S
        if lost.any():
            x = np.where(lost, data.values[k], x)
            v = np.where(lost, 0.0, v)
            pxx = np.where(lost, _START_VARIANCE, pxx)
            pxv, pvv = np.where(lost, 0.0, pxv), np.where(lost, start_v, pvv)
        innovation = data.values[k] - x - w
        gx, gv, gw = pxx + pxw, pxv + pvw, pxw + pww
        s = gx + gw + r
        use = data.used[k]
        if gate < np.inf:
            use = use & (np.abs(innovation[-1] / np.sqrt(s[-1])).max(axis=0) <= gate)
        innovations[k], variances[k], uses[k] = innovation, s, use
        unseen_s[use] = 0.0
        share = use / s
        kx, kv, kw = gx * share, gv * share, gw * share
        x, v, w = x + kx * innovation, v + kv * innovation, w + kw * innovation
        pxx, pxv, pxw = pxx - kx * gx, pxv - kx * gv, pxw - kx * gw
        pvv, pvw, pww = pvv - kv * gv, pvw - kv * gw, pww - kw * gw
    terms = -0.5 * (np.log(2.0 * np.pi * variances) + innovations**2 / variances)
    normalised = innovations[:, -1] / np.sqrt(variances[:, -1])
    return Likelihood(
        np.where(uses[:, None, None], terms, 0.0).sum(axis=0), np.where(data.used[:, None], normalised, np.nan)
    )


def runs(flags: BoolArray) -> IntArray:
    """First and one past the last frame of each run of true flags.

    Args:
        flags: Shape (N,).

    Returns:
        Shape (K, 2).
    """
    return np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]]))).reshape(-1, 2)


@dataclass(frozen=True)
class _Layout:
    """Place of each parameter in the vector of logarithms, for each group of axes."""

    groups: Groups
    wanders: tuple[bool, ...]
    one_person: bool

    @property
    def at(self) -> dict[tuple[str, int], int]:
        names = [("acceleration", g) for g in range(1 if self.one_person else len(self.groups))]
        for g, wanders in enumerate(self.wanders):
            names.append(("white", g))
            if wanders:
                names += [("wander", g), ("correlation", g)]
        return {name: k for k, name in enumerate(names)}

    def model(self, theta: FloatArray) -> ErrorModel:
        """Parameters of G trials, `theta` of shape (G, P)."""
        at = self.at
        axes = sum(len(group) for group in self.groups)
        parts = {name: np.full((len(theta), axes), 1e-9) for name in _BOUNDS}
        parts["correlation"][:] = 1.0
        for g, group in enumerate(self.groups):
            for name, part in parts.items():
                key = (name, 0 if name == "acceleration" and self.one_person else g)
                if key in at:
                    part[:, list(group)] = np.exp(theta[:, at[key]])[:, None]
        return ErrorModel(parts["acceleration"], parts["white"], parts["wander"], parts["correlation"])

    def log_prior(self, theta: FloatArray) -> FloatArray:
        """Logarithm of the weak priors without its constant, shape (G,), of `theta` of shape (G, P)."""
        at = self.at
        total = np.zeros(len(theta))
        for (name, g), k in at.items():
            if name in _PRIORS:
                centre, sd = _PRIORS[name]
                value = theta[:, k] - theta[:, at["white", g]] if name == "wander" else theta[:, k]
                total -= 0.5 * ((value - centre) / sd) ** 2
        return total


def _fit(
    data: Stretches, groups: Groups, one_person: bool, white_start: FloatArray
) -> tuple[tuple[GroupFit, ...], ErrorModel]:
    """Fit person, white error and, where it raises the likelihood enough, wander; `white_start` of shape (groups,)."""
    layout = _Layout(groups, (True,) * len(groups), one_person)
    theta, log = _maximum(data, layout, white_start)
    for g in range(len(groups)):
        less = _Layout(groups, tuple(w and k != g for k, w in enumerate(layout.wanders)), one_person)
        theta_less, log_less = _maximum(data, less, white_start)
        if log - log_less < _WANDER_GAIN:
            layout, theta, log = less, theta_less, log_less
    values = np.exp(theta)
    sds = values * _log_sds(data, layout, theta)
    found = {name: Known(float(values[k]), float(sds[k])) for name, k in layout.at.items()}
    fits = tuple(
        GroupFit(found["white", g], found.get(("wander", g)), found.get(("correlation", g))) for g in range(len(groups))
    )
    return fits, layout.model(theta[None])


def _maximum(data: Stretches, layout: _Layout, white_start: FloatArray) -> tuple[FloatArray, float]:
    """Maximum of the posterior: logarithms of the parameters, shape (P,), and the logarithm of its density."""
    names = list(layout.at)
    n = len(names)
    bounds = [tuple(np.log(_BOUNDS[name])) for name, _ in names]
    starts = {"acceleration": np.log(0.3), "correlation": np.log(0.5)}
    start = np.array([starts.get(name, np.log(white_start[g])) for name, g in names])
    steps = _STEP * np.vstack([np.zeros(n), np.eye(n), -np.eye(n)])

    def cost(theta: FloatArray) -> tuple[float, FloatArray]:
        trials = theta + steps
        values = likelihood(data, layout.model(trials)).log.sum(axis=(1, 2)) + layout.log_prior(trials)
        return -values[0], -(values[1 : n + 1] - values[n + 1 :]) / (2.0 * _STEP)

    found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _ITERATIONS})
    return np.asarray(found.x), -float(found.fun)


def _log_sds(data: Stretches, layout: _Layout, theta: FloatArray) -> FloatArray:
    """Standard deviations of the logarithms, shape (P,): the larger of two estimates, by curvature and by stretches."""
    n, h = len(theta), _CURVATURE_STEP
    e = h * np.eye(n)
    points = [np.zeros(n), *e, *-e]
    pairs = list(combinations(range(n), 2))
    for i, j in pairs:
        points += [e[i] + e[j], e[i] - e[j], -e[i] + e[j], -e[i] - e[j]]
    trials = theta + np.array(points)
    each = likelihood(data, layout.model(trials)).log.sum(axis=1)
    log = each.sum(axis=1) + layout.log_prior(trials)
    curvature = np.diag((log[1 : n + 1] - 2.0 * log[0] + log[n + 1 : 2 * n + 1]) / h**2)
    for k, (i, j) in enumerate(pairs):
        a, b, c, d = log[2 * n + 1 + 4 * k : 2 * n + 5 + 4 * k]
        curvature[i, j] = curvature[j, i] = (a - b - c + d) / (4.0 * h**2)
    inverse = np.linalg.pinv(-curvature, hermitian=True)
    slopes = (each[1 : n + 1] - each[n + 1 : 2 * n + 1]) / (2.0 * h)
    slopes = slopes - slopes.mean(axis=1, keepdims=True)
    between = inverse @ (slopes @ slopes.T) @ inverse
    return np.asarray(np.sqrt(np.maximum(np.clip(np.diag(inverse), 0.0, None), np.diag(between))))


def _third_differences(data: Stretches, group: tuple[int, ...]) -> float:
    """White error plus the fast part of the person's motion. The median ignores jumps."""
    found = []
    for b in range(data.used.shape[1]):
        values = data.values[data.used[:, b]][:, list(group), b]
        found.append(np.abs(np.diff(values, 3, axis=0)).ravel())
    return max(_LEAST, _NORMAL * float(np.median(np.concatenate(found))) / math.sqrt(_THIRD_DIFFERENCES))


def _jumps_in(data: Stretches, odd: BoolArray) -> BoolArray:
    """Which odd frames are in jumps, reached in one step, shape (F, B). The others are the person's motion."""
    jumps = odd.copy()
    for b in range(odd.shape[1]):
        aside = np.abs(_aside(data, odd, b))
        for first, last in runs(odd[: len(aside), b]):
            way = aside[first:last].max(axis=0)
            axis = int(np.argmax(way))
            # After a jump the filter needs time to accept the track again. Frames back on the track are no part of it.
            there = aside[first:last, axis] >= _STEP_SHARE * way[axis]
            jumps[first:last, b] = there & there[0]
    return jumps


def _aside(data: Stretches, out: BoolArray, b: int) -> FloatArray:
    """Distance of each frame of a stretch from the path interpolated between the kept frames, shape (F, A)."""
    frames = int(data.used[:, b].sum())
    kept = ~out[:frames, b]
    times_s, values = np.cumsum(data.intervals_s[:frames, b]), data.values[:frames, :, b]
    if not kept.any():
        return np.zeros_like(values)
    expected = [np.interp(times_s, times_s[kept], column[kept]) for column in values.T]
    return np.asarray(values - np.transpose(expected))


def _jumps(data: Stretches, used: BoolArray) -> TrackJumps:
    durations_s: list[float] = []
    sizes: list[FloatArray] = []
    for b in range(used.shape[1]):
        aside = _aside(data, ~used, b)
        times_s = np.cumsum(data.intervals_s[: len(aside), b])
        for first, last in runs(~used[: len(aside), b]):
            durations_s.append(float(times_s[last - 1] - times_s[first]))
            sizes.append(np.sqrt((aside[first:last] ** 2).mean(axis=0)))
    return TrackJumps(np.array(durations_s), np.reshape(sizes, (-1, data.values.shape[1])))
