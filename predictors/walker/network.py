"""The model of `Walker`: ensembles of networks for the departure from a line, and the scale of the forecast errors."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from predictors.types import FloatArray
from predictors.walker.features import KNOWN, MIRROR, N_INPUTS, N_SPREAD
from predictors.walker.memories import N_PLACES

Float32Array = NDArray[np.float32]

# Horizons of the networks' departures; a cubic spline interpolates between them.
KNOTS_S = np.array([0.0, 0.125, 0.25, 0.375, 0.5, 0.75, 1.0, 1.5])
# Typical departure at each knot: it scales the networks' outputs to order one.
DEPARTURE_SCALE_M = np.array([0.015, 0.02, 0.03, 0.045, 0.06, 0.1, 0.15, 0.25])
# Regime of staying: critically damped return from the newest position, at rest, to the place of staying, with this time
# constant, seconds. Of 0.25, 0.4 and 0.6 s, on standing people left out of the fit and on bags of a face tracker, with
# necks of 0.03 to 0.4 s of dead time: a shorter one reduces the accuracy of fast necks, a longer one passes the wander
# of a body tracker.
_RETURN_TIME_S = 0.4
_RETURNED = 1.0 - (1.0 + KNOTS_S / _RETURN_TIME_S) * np.exp(-KNOTS_S / _RETURN_TIME_S)
_LOG_SPREAD_RANGE = (math.log(0.002), math.log(5.0))  # metres
# Outputs: departures from the line in the regime of walking, logit of walking, logits of the places of staying.
DEPARTURES = slice(0, 3 * KNOTS_S.size)
WALKS, PLACES = DEPARTURES.stop, slice(DEPARTURES.stop + 1, DEPARTURES.stop + 1 + N_PLACES)
N_OUTPUTS = PLACES.stop
# Features of the uncertainty model: N_SPREAD inputs; size of the departure across at 0.5 s, across and along at 1 s;
# standard deviation over the ensemble; distance between walking and staying; probability of walking.
N_DOUBT = N_SPREAD + 6
_NEAR, _FAR = 4, 6
_USUAL_DEPARTURE_M = np.array([0.06, 0.2, 0.2])
_USUAL_DISAGREEMENT_M = 0.02
# Scale of the outputs for the given inputs and for the mirrored ones, shape (2, 1, knots, 3).
_SCALES_M = DEPARTURE_SCALE_M[:, None] * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])[:, None, None]


class WalkerModelError(ValueError):
    """A file or its parameters are not a valid model of `Walker`."""


@dataclass(frozen=True)
class RegimeMotion:
    """Inputs of the two regimes, walking along the line and staying, for N people.

    Attributes:
        line_m_s: Velocity of each line along, across and up, shape (N, 3).
        places_m: Candidate places of staying relative to the line's origin, shape (N, N_PLACES, 3), metres.
    """

    line_m_s: FloatArray
    places_m: FloatArray


@dataclass(frozen=True)
class Regimes:
    """Outputs of an ensemble: the motion of N people in the two regimes, before the decision between them.

    The first axis is the network: E with the given inputs, then E with the mirrored ones.

    Attributes:
        walk_m: Departure from the line if the person walks, shape (2 E, N, knots, 3), metres along, across and up.
        stay_m: Departure from the line if the person stays, same shape.
        logit: Log-odds of walking, shape (2 E, N).
    """

    walk_m: FloatArray
    stay_m: FloatArray
    logit: FloatArray

    @property
    def evidence(self) -> FloatArray:
        """Mean logit of the ensemble, shape (N,)."""
        return np.asarray(np.add.reduce(self.logit, axis=0) / len(self.logit))

    @staticmethod
    def mean(parts: list[tuple[Regimes, FloatArray]]) -> Regimes:
        """Weighted mean of the outputs of several ensembles.

        Args:
            parts: Outputs and their weights, shape (N,); the weights sum to one.
        """
        if len(parts) == 1:
            return parts[0][0]
        return Regimes(
            reduce(np.add, (share[:, None, None] * outputs.walk_m for outputs, share in parts)),
            reduce(np.add, (share[:, None, None] * outputs.stay_m for outputs, share in parts)),
            reduce(np.add, (share * outputs.logit for outputs, share in parts)),
        )


@dataclass(frozen=True)
class Ensemble:
    """E networks of equal shape, evaluated together.

    Attributes:
        weights: One array a layer, shape (E, inputs, outputs).
        biases: One array a layer, shape (E, 1, outputs).

    Raises:
        WalkerModelError: If a shape is wrong or a number is not finite.
    """

    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]

    def __post_init__(self) -> None:
        if not self.weights or len(self.weights) != len(self.biases):
            raise WalkerModelError("a network needs one bias a layer")
        ensemble = self.weights[0].shape[0] if self.weights[0].ndim else 0
        n = N_INPUTS
        for w, b in zip(self.weights, self.biases, strict=True):
            if w.ndim != 3 or w.shape[:2] != (ensemble, n) or b.shape != (ensemble, 1, w.shape[2]):
                raise WalkerModelError(f"layer of shape {w.shape} with bias {b.shape} does not take {n} inputs")
            n = w.shape[2]
        if n != N_OUTPUTS:
            raise WalkerModelError(f"{n} outputs, expected {N_OUTPUTS}")
        if not all(np.isfinite(a).all() for a in (*self.weights, *self.biases)):
            raise WalkerModelError("a number is not finite")

    @cached_property
    def _first(self) -> Float32Array:
        # The first layers share their inputs: one matrix product for the ensemble, most of the computation.
        return np.concatenate(list(self.weights[0]), axis=1)

    def __call__(self, network: FloatArray, motion: RegimeMotion) -> Regimes:
        """Outputs of all networks for N inputs and their mirror images.

        Args:
            network: Inputs, shape (N, N_INPUTS).
            motion: Motion in the two regimes.
        """
        ensemble, _, hidden = self.weights[0].shape
        first = np.concatenate([network, network * MIRROR]).astype(np.float32) @ self._first
        h = first.reshape(-1, ensemble, hidden).transpose(1, 0, 2) + self.biases[0]
        for w, b in zip(self.weights[1:], self.biases[1:], strict=True):
            h = np.tanh(h) @ w + b
        outputs = h.reshape(ensemble, 2, len(network), N_OUTPUTS).astype(np.float64)
        departures = outputs[..., DEPARTURES].reshape(ensemble, 2, len(network), KNOTS_S.size, 3) * _SCALES_M
        shape = (2 * ensemble, len(network), KNOTS_S.size, 3)
        stays = staying(outputs[..., PLACES], motion, _RETURNED)
        return Regimes(departures.reshape(shape), stays.reshape(shape), outputs[..., WALKS].reshape(shape[:2]))


def staying(places: Any, motion: RegimeMotion, returned: Any, xp: Any = np) -> Any:
    """Departure from the line in the regime of staying.

    Args:
        places: Logits of the places of staying, shape (..., N, N_PLACES).
        motion: Motion in the two regimes.
        returned: Share of the way from the newest position to the mean of the places at each knot, shape (knots,).
        xp: numpy, or jax.numpy where the networks are fitted.

    Returns:
        Shape (..., N, knots, 3), metres: return from the newest position to the mean of the places, weighted by the
        softmax of the logits.
    """
    share = xp.exp(places - places.max(axis=-1, keepdims=True))
    mean_m = share[..., None, :] @ motion.places_m / share.sum(axis=-1)[..., None, None]
    begin_m = (1.0 - returned)[:, None] * motion.places_m[:, :1]
    return begin_m - KNOTS_S[:, None] * motion.line_m_s[:, None] + returned[:, None] * mean_m


@dataclass(frozen=True)
class WalkerModel:
    """Parameters of the fitted model.

    Attributes:
        seeing: Networks for tracks with an orientation.
        blind: Networks for tracks without orientation.
        precise: Networks for tracks with an orientation and a small error.
        log_spread: Coefficients of the logarithm of the errors' scale (m) at each knot along, across and up, shape
            (N_DOUBT, knots, 3), without the stated error of the observation.
        hidden: Weights of the tanh units of the logarithm's nonlinear part, shape (N_DOUBT, units).
        log_spread_hidden: Coefficients of these units, shape (units, knots, 3).
        noise_share: Factor at each knot from the observation's stated standard deviation, in every direction, to its
            part of the forecast's scale, shape (knots,).
        decision: Slope and threshold of the decision between walking and staying: the weight of walking is the
            logistic function of slope (logit - threshold). Slope 1 and threshold 0, as in the fit, minimise the mean
            error. A steeper slope approaches a hard decision; a higher threshold reduces false starts and delays true
            ones.
        degrees_of_freedom: Degrees of freedom of the errors' t distribution, above 2.
        about: Provenance: recordings, people, command, versions, errors on people left out.

    Raises:
        WalkerModelError: If a shape is wrong or a number is not finite.
    """

    seeing: Ensemble
    blind: Ensemble
    precise: Ensemble
    log_spread: FloatArray
    hidden: FloatArray = field(default_factory=lambda: np.zeros((N_DOUBT, 0)))
    log_spread_hidden: FloatArray = field(default_factory=lambda: np.zeros((0, KNOTS_S.size, 3)))
    noise_share: FloatArray = field(default_factory=lambda: np.zeros(KNOTS_S.size))
    decision: tuple[float, float] = (1.0, 0.0)
    degrees_of_freedom: float = 5.0
    about: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len({len(ensemble.weights[0]) for ensemble in (self.seeing, self.blind, self.precise)}) > 1:
            raise WalkerModelError("the ensembles have different numbers of networks")
        knots, units = KNOTS_S.size, self.hidden.shape[-1]
        sizes = {
            "log_spread": (N_DOUBT, knots, 3),
            "hidden": (N_DOUBT, units),
            "log_spread_hidden": (units, knots, 3),
            "noise_share": (knots,),
        }
        parts = {name: getattr(self, name) for name in sizes}
        if {name: part.shape for name, part in parts.items()} != sizes:
            raise WalkerModelError(f"the shapes of {', '.join(sizes)} do not fit {knots} knots")
        if not all(np.isfinite(a).all() for a in parts.values()):
            raise WalkerModelError("a number is not finite")
        if not (len(self.decision) == 2 and 0.0 < self.decision[0] < math.inf and math.isfinite(self.decision[1])):
            raise WalkerModelError(f"decision is {self.decision}, expected a positive slope and a threshold")
        if not self.degrees_of_freedom > 2.0:  # below, a t distribution has no covariance
            raise WalkerModelError(f"degrees_of_freedom is {self.degrees_of_freedom}, expected more than 2")

    def regimes(self, network: FloatArray, motion: RegimeMotion, precise: FloatArray) -> Regimes:
        """Motion in the two regimes, and the log-odds of walking.

        Each input is evaluated with its mirror image, so the model is symmetric in left and right. Separate ensembles
        serve tracks without orientation and precise trackers; the outputs are blended by the weights of orientation
        and precision.

        Args:
            network: Inputs of the network, shape (N, N_INPUTS).
            motion: Motion in the two regimes.
            precise: Weight of precise trackers, shape (N,), 0 to 1.

        Returns:
            Outputs of the ensembles, for `answer`.
        """
        seen = np.maximum.reduce(network[:, KNOWN], axis=1)
        shares = (self.seeing, seen * (1.0 - precise)), (self.blind, 1.0 - seen), (self.precise, seen * precise)
        return Regimes.mean([(ensemble(network, motion), share) for ensemble, share in shares if share.any()])

    def answer(
        self, regimes: Regimes, spread: FloatArray, evidence: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Departures from the lines, and the features of the uncertainty model.

        The forecast is the mixture mean of both regimes.

        Args:
            regimes: Outputs of the networks.
            spread: Inputs of the uncertainty model, shape (N, N_SPREAD).
            evidence: Filtered log-odds of walking in place of the ensemble's mean, shape (N,).

        Returns:
            Departures, mean over the ensemble, shape (N, knots, 3), metres along, across and up. Features for
            `spread_m`, shape (N, N_DOUBT): `spread`, the size of the departure, the standard deviation over the
            ensemble, the distance between the two regimes, and the probability of walking.
        """
        slope, threshold = self.decision
        shift = 0.0 if evidence is None else evidence - regimes.evidence
        walks = 1.0 / (1.0 + np.exp(slope * (threshold - regimes.logit - shift)))
        apart = regimes.walk_m - regimes.stay_m
        far = np.hypot(apart[..., _FAR, 0], apart[..., _FAR, 1])
        outputs = regimes.stay_m + walks[..., None, None] * apart
        n = len(outputs)
        departure = np.add.reduce(outputs, axis=0) / n
        # Disagreement in the horizontal plane, where turns take place.
        off = outputs[:, :, _FAR, :2] - departure[:, _FAR, :2]
        disagreement = np.sqrt(np.add.reduce(off * off, axis=(0, 2)) / n)
        regime_sd_m = np.sqrt(np.add.reduce(walks * (1.0 - walks) * far * far, axis=0) / n)
        doubt = np.empty((len(spread), N_DOUBT))
        doubt[:, :N_SPREAD] = spread
        size = doubt[:, N_SPREAD : N_SPREAD + 3]
        size[:, :2], size[:, 2] = departure[:, _NEAR : _FAR + 1 : _FAR - _NEAR, 1], departure[:, _FAR, 0]
        np.minimum(np.abs(size) / _USUAL_DEPARTURE_M, 4.0, out=size)
        doubt[:, -3] = np.log1p(disagreement / _USUAL_DISAGREEMENT_M)
        doubt[:, -2] = np.log1p(regime_sd_m / _USUAL_DISAGREEMENT_M)
        doubt[:, -1] = np.add.reduce(walks, axis=0) / n
        return departure, doubt

    def spread_m(self, doubt: FloatArray) -> FloatArray:
        """Standard deviation of the forecast errors: scale of the t distribution times the root of v / (v - 2).

        Args:
            doubt: Features of the uncertainty model, shape (N, N_DOUBT).

        Returns:
            Shape (N, knots, 4): metres along, across and up without the observation's stated error; the factor of the
            stated error.
        """
        log_spread = doubt @ self.log_spread.reshape(N_DOUBT, -1)
        log_spread += np.tanh(doubt @ self.hidden) @ self.log_spread_hidden.reshape(
            len(self.log_spread_hidden), 3 * KNOTS_S.size
        )
        bounded = np.minimum(np.maximum(log_spread, _LOG_SPREAD_RANGE[0]), _LOG_SPREAD_RANGE[1])
        spread = np.empty((len(doubt), KNOTS_S.size, 4))
        np.exp(bounded.reshape(-1, KNOTS_S.size, 3), out=spread[..., :3])
        spread[..., 3] = self.noise_share
        spread /= math.sqrt(1.0 - 2.0 / self.degrees_of_freedom)  # this form also holds for a normal distribution
        return spread
