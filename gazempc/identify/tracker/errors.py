"""White error and wander of a track by maximum likelihood, with its jumps left out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import Bounds, minimize

from gazempc.identify.tracker.likelihood import Stretches, likelihood
from gazempc.types import BoolArray, FloatArray, IntArray

# Parameters of a group of axes, in this order: root spectral density of the person's acceleration, m s^-1.5; standard
# deviations of white error and wander, in the unit of the values; correlation time of the wander, seconds.
_WHITE, _WANDER, _CORRELATION = 1, 2, 3
_LOW, _HIGH = np.log([1e-3, 1e-6, 1e-6, 0.03]), np.log([30.0, 1.0, 1.0, 20.0])
# Of a group without wander.
_NO_WANDER = (1e-9, 1.0)
# Weak priors of the logarithms: they bound parameters that the data do not determine; ten seconds of data outweigh
# them. A person who stands sways with about 0.02 m s^-1.5, one who walks moves with 1. That of the wander is of its
# ratio to the white error, which has none.
_PRIOR_CENTRE, _PRIOR_SD = np.log([0.2, 1.0, 1.0, 1.0]), np.array([1.5, np.inf, 1.5, 1.0])
# A wander has two parameters and must raise the log-likelihood by half of the 99 % quantile of χ² with 2 degrees of
# freedom: in 1 % of tracks without wander it does so by chance.
_WANDER_GAIN = 4.6
_STEP, _CURVATURE_STEP = 1e-3, 0.03  # of finite differences of the logarithms
# A normal innovation is larger once in 150,000 frames and axes.
_GATE = 4.5
_ROUNDS = 3
# Standard deviation of a normal distribution over its median absolute deviation.
_NORMAL = 1.4826
# The variance of third differences of white noise is this many times its own. If the fitted white error is below this
# share of theirs, the person's motion or the tracker's smoothing hides it.
_THIRD_DIFFERENCES, _HIDDEN = 20.0, 0.4
# No tracker has less error; the fit of a logarithm needs a positive start.
_LEAST = 1e-5
# Each frame of a jump, also the first, is at least this share of its size away. A person starts to move more slowly.
_STEP_SHARE = 0.5


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


def measure_errors(
    data: Stretches, groups: tuple[int, ...], one_person: bool, report: Callable[[float], None]
) -> tuple[tuple[GroupFit, ...], TrackJumps]:
    """Fit errors, leave jumps out, and fit again.

    Args:
        data: Stretches of the track.
        groups: Group of each axis, shape (A,); the axes of a group share their errors, such as ``(0, 1, 1)`` for along
            and across.
        one_person: True where the person's acceleration is one for all groups (a standing person sways alike in all
            directions); False where each group has its own.
        report: Called with the share that is done, 0 to 1.

    Returns:
        One fit a group, and the jumps that the fits leave out.
    """
    of_axis = np.array(groups)
    rough = np.array([_third_differences(data, of_axis == g) for g in range(max(groups) + 1)])
    start, used = rough, data.used
    for k in range(_ROUNDS):
        report(k / _ROUNDS)
        fits, parameters = _fit(replace(data, used=used), of_axis, one_person, start)
        _, normalised = likelihood(data, parameters, _GATE)
        sizes = np.abs(np.nan_to_num(normalised)).max(axis=1)
        calm = data.used & ~jumps_in(data, data.used & (sizes > _GATE))
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
    return bounded, track_jumps(data, used)


@dataclass(frozen=True)
class _Posterior:
    """Density of the logarithms of the free parameters, shape (P,); trials have shape (T, P).

    Attributes:
        data: The stretches.
        of_axis: Group of each axis, shape (A,).
        free: Which parameters of each group are fitted, shape (4, groups).
        one_person: Whether the acceleration of the first group is that of all.
    """

    data: Stretches
    of_axis: IntArray
    free: BoolArray
    one_person: bool

    def _logarithms(self, trials: FloatArray) -> FloatArray:
        all_of_them = np.zeros((len(trials), *self.free.shape))
        all_of_them[:, _WANDER:] = np.log(_NO_WANDER)[:, None]
        all_of_them[:, self.free] = trials
        if self.one_person:
            all_of_them[:, 0] = all_of_them[:, 0, :1]
        return all_of_them

    def parameters(self, trials: FloatArray) -> FloatArray:
        """Parameters on each axis, shape (T, 4, A)."""
        return np.exp(self._logarithms(trials))[..., self.of_axis]

    def log(self, trials: FloatArray) -> FloatArray:
        """Log-likelihood of each stretch and, last, logarithm of the prior without its constant, shape (T, B + 1)."""
        off = self._logarithms(trials)
        off[:, _WANDER] -= off[:, _WHITE]
        off = (off - _PRIOR_CENTRE[:, None]) / _PRIOR_SD[:, None]
        each, _ = likelihood(self.data, self.parameters(trials))
        return np.column_stack([each.sum(axis=1), -0.5 * (off[:, self.free] ** 2).sum(axis=1)])

    def slopes(self, theta: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
        """`log` at one place, shape (B + 1,), and its derivatives by central differences, shape (P, B + 1)."""
        steps = step * np.eye(theta.size)
        here, *around = self.log(theta + np.vstack([np.zeros(theta.size), steps, -steps]))
        return here, (np.array(around[: theta.size]) - around[theta.size :]) / (2.0 * step)

    def maximum(self, white_start: FloatArray) -> tuple[FloatArray, float]:
        """The place of the maximum, shape (P,), and the logarithm of the density there."""
        start: FloatArray = np.repeat(np.log([[0.3], [1.0], [1.0], [0.5]]), white_start.size, axis=1)
        start[_WHITE : _WANDER + 1] = np.log(white_start)
        low, high = (np.broadcast_to(end[:, None], start.shape)[self.free] for end in (_LOW, _HIGH))

        def cost(theta: FloatArray) -> tuple[float, FloatArray]:
            log, slopes = self.slopes(theta, _STEP)
            return -float(log.sum()), -slopes.sum(axis=1)

        found = minimize(
            cost, start[self.free], jac=True, method="L-BFGS-B", bounds=Bounds(low, high), options={"maxiter": 200}
        )
        return np.asarray(found.x), -float(found.fun)

    def sds(self, theta: FloatArray) -> FloatArray:
        """Standard deviations, shape (P,): the larger of two estimates, by curvature and by stretches."""
        each = _CURVATURE_STEP * np.eye(theta.size)
        curvature = np.array([self._slope(theta + e) - self._slope(theta - e) for e in each]) / (2 * _CURVATURE_STEP)
        inverse = np.linalg.pinv(-0.5 * (curvature + curvature.T), hermitian=True)
        slopes = self.slopes(theta, _CURVATURE_STEP)[1][:, :-1]
        slopes = slopes - slopes.mean(axis=1, keepdims=True)
        between = inverse @ (slopes @ slopes.T) @ inverse
        return np.asarray(np.sqrt(np.maximum(np.clip(np.diag(inverse), 0.0, None), np.diag(between))))

    def _slope(self, theta: FloatArray) -> FloatArray:
        return np.asarray(self.slopes(theta, _STEP)[1].sum(axis=1))


def _fit(
    data: Stretches, of_axis: IntArray, one_person: bool, white_start: FloatArray
) -> tuple[tuple[GroupFit, ...], FloatArray]:
    """Fit person, white error and, where it raises the likelihood enough, wander; `white_start` of shape (groups,)."""
    free = np.ones((4, white_start.size), dtype=np.bool_)
    free[0, 1:] = not one_person
    posterior = _Posterior(data, of_axis, free, one_person)
    theta, log = posterior.maximum(white_start)
    for g in range(white_start.size):
        fewer = posterior.free.copy()
        fewer[_WANDER:, g] = False
        simpler = replace(posterior, free=fewer)
        theta_simpler, log_simpler = simpler.maximum(white_start)
        if log - log_simpler < _WANDER_GAIN:
            posterior, theta, log = simpler, theta_simpler, log_simpler
    free = posterior.free
    known = np.full(free.shape, None)
    known[free] = [Known(float(v), float(v * sd)) for v, sd in zip(np.exp(theta), posterior.sds(theta), strict=True)]
    return tuple(GroupFit(*known[_WHITE:, g]) for g in range(white_start.size)), posterior.parameters(theta[None])


def _third_differences(data: Stretches, axes: BoolArray) -> float:
    """White error plus the fast part of the person's motion. The median ignores jumps."""
    stretches = (data.values[used][:, axes, b] for b, used in enumerate(data.used.T))
    sizes = np.concatenate([np.abs(np.diff(values, 3, axis=0)).ravel() for values in stretches])
    return max(_LEAST, _NORMAL * float(np.median(sizes)) / math.sqrt(_THIRD_DIFFERENCES))


@dataclass(frozen=True)
class TrackJumps:
    """Jumps of a track: frames far from the position interpolated between the frames before and after.

    Attributes:
        durations_s: Of each, shape (K,), seconds; 0 for a single frame.
        sizes: Root mean square of each on each axis, in the unit of the values, shape (K, A).
    """

    durations_s: FloatArray
    sizes: FloatArray


def runs(flags: BoolArray) -> IntArray:
    """First and one past the last frame of each run of true flags.

    Args:
        flags: Shape (N,).

    Returns:
        Shape (K, 2).
    """
    return np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]]))).reshape(-1, 2)


def jumps_in(data: Stretches, odd: BoolArray) -> BoolArray:
    """Odd frames that belong to jumps; the others are the person's motion.

    Args:
        data: Stretches of the track.
        odd: Frames whose innovation is outside of the gate, shape (F, B).

    Returns:
        Frames of jumps, shape (F, B); a jump is reached in one step.
    """
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


def track_jumps(data: Stretches, used: BoolArray) -> TrackJumps:
    """Durations and sizes of the jumps that a fit leaves out.

    Args:
        data: Stretches of the track.
        used: Frames that the fit uses, shape (F, B).

    Returns:
        One entry for each run of frames that it does not use.
    """
    durations_s: list[float] = []
    sizes: list[FloatArray] = []
    for b in range(used.shape[1]):
        aside = _aside(data, ~used, b)
        times_s = np.cumsum(data.intervals_s[: len(aside), b])
        for first, last in runs(~used[: len(aside), b]):
            durations_s.append(float(times_s[last - 1] - times_s[first]))
            sizes.append(np.sqrt((aside[first:last] ** 2).mean(axis=0)))
    return TrackJumps(np.array(durations_s), np.reshape(sizes, (-1, data.values.shape[1])))
