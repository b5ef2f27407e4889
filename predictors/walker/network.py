"""The model of `Walker` and its file: networks, departures at the knots, scale of the errors."""

from __future__ import annotations

import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import IO, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from predictors.types import FloatArray
from predictors.walker.bank import Compiled
from predictors.walker.features import KNOWN, MIRROR, N_INPUTS, N_PLACES, N_SPREAD, N_VELOCITIES
from predictors.walker.knots import KNOTS_S

Float32Array = NDArray[np.float32]

# Typical departure at each knot: it scales the networks' outputs to order one.
DEPARTURE_SCALE_M = np.array([0.015, 0.02, 0.03, 0.045, 0.06, 0.1, 0.15, 0.25])
# Regime of staying: critically damped return from the newest position to the place of staying, with this time constant,
# seconds. Of 0.25, 0.4 and 0.6 s, on standing people left out of the fit and on bags of a face tracker, with necks of
# 0.03 to 0.4 s of dead time: a shorter one reduces the accuracy of fast necks, a longer one passes the wander of a body
# tracker. The transient of an initial velocity is the impulse response of a critically damped system: of 0.4, 0.7 and
# 1.1 s, on a person who steps on the spot (left out of the fit) and on starting, waiting and walking people, the
# shortest increases the error of the forecast for the person on the spot by up to 4 %, the longest the RMS acceleration
# of the predicted bearing by up to 7 %.
_RETURN_TIME_S, _TRANSIENT_TIME_S = 0.4, 0.7
_RETURNED = 1.0 - (1.0 + KNOTS_S / _RETURN_TIME_S) * np.exp(-KNOTS_S / _RETURN_TIME_S)
TRANSIENT_S = KNOTS_S * np.exp(-KNOTS_S / _TRANSIENT_TIME_S)  # displacement per unit of initial velocity
_LOG_SPREAD_RANGE = (math.log(0.002), math.log(5.0))  # metres
# Outputs: departures from the line in the regime of walking, logit of walking; in the regime of staying, logits of the
# places, and of rest and the filters' velocities as initial velocity.
DEPARTURES, WALKS = slice(0, 3 * KNOTS_S.size), 3 * KNOTS_S.size
PLACES, VELOCITIES = slice(WALKS + 1, -N_VELOCITIES), slice(-N_VELOCITIES, None)
N_OUTPUTS = WALKS + 1 + N_PLACES + N_VELOCITIES
# Factors of the inputs for a track and its mirror image, and of their outputs, to metres.
_BOTH_SIDES, _OF_BOTH_SIDES = np.stack([np.ones(N_INPUTS), MIRROR]), np.ones((2, N_OUTPUTS))
_OF_BOTH_SIDES[:, DEPARTURES] = np.repeat(DEPARTURE_SCALE_M, 3)
_OF_BOTH_SIDES[1, 1 : DEPARTURES.stop : 3] *= -1.0
# Features of the uncertainty model: N_SPREAD inputs; size of the departure across at 0.5 s, across and along at 1 s;
# half the distance at 1 s between the forecasts for input and mirror image; distance between walking and staying;
# probability of walking.
N_DOUBT = N_SPREAD + 6
_NEAR, _FAR = 4, 6
_USUAL_DEPARTURE_M, _USUAL_DISTANCE_M, _LARGEST_SIZE = np.array([0.06, 0.2, 0.2]), 0.02, 4.0


class WalkerModelError(ValueError):
    """A file or its parameters are not a valid model of `Walker`."""


def _check(array: NDArray[Any], name: str, shape: tuple[int, ...]) -> None:
    if array.shape != shape or not np.isfinite(array).all():
        raise WalkerModelError(f"{name}: an array of shape {array.shape}, expected finite numbers of shape {shape}")


@dataclass(frozen=True)
class Network:
    """A feedforward network with tanh hidden units and a linear output layer.

    Attributes:
        weights: One array a layer, shape (inputs, outputs).
        biases: One array a layer, shape (outputs,).

    Raises:
        WalkerModelError: If a shape is wrong or a number is not finite.
    """

    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]

    def __post_init__(self) -> None:
        if not self.weights or len(self.weights) != len(self.biases):
            raise WalkerModelError("a network needs at least one layer, and one bias a layer")
        sizes = [N_INPUTS, *(b.size for b in self.biases[:-1]), N_OUTPUTS]
        for layer, w, b, shape in zip(range(1, len(sizes)), self.weights, self.biases, pairwise(sizes), strict=True):
            _check(w, f"weights of layer {layer}", shape)
            _check(b, f"biases of layer {layer}", shape[1:])

    @classmethod
    def of(cls, arrays: Mapping[str, Any], prefix: str = "") -> Network:
        """The network of named arrays.

        Args:
            arrays: Arrays by name, as from `arrays`.
            prefix: Prefix of their names.

        Returns:
            The network.

        Raises:
            KeyError: If an array is missing.
            WalkerModelError: If a shape is wrong or a number is not finite.
        """
        layers = range(sum(name.startswith(f"{prefix}weights_") for name in arrays))
        return cls(*(tuple(arrays[f"{prefix}{what}_{i}"] for i in layers) for what in ("weights", "biases")))

    def arrays(self, prefix: str = "") -> dict[str, Float32Array]:
        """Weights and biases by name and layer, such as ``weights_0``, after a prefix."""
        return {f"{prefix}{what}_{i}": layer for what, layers in vars(self).items() for i, layer in enumerate(layers)}

    def __call__(self, inputs: FloatArray) -> FloatArray:
        """Outputs for an input and for its mirror image.

        Args:
            inputs: Shape (N_INPUTS,).

        Returns:
            Shape (2, N_OUTPUTS): departures in metres along, across and up, logits.
        """
        h = (_BOTH_SIDES * inputs).astype(np.float32) @ self.weights[0] + self.biases[0]
        for w, b in zip(self.weights[1:], self.biases[1:], strict=True):
            h = np.tanh(h) @ w + b
        return h * _OF_BOTH_SIDES


@dataclass(frozen=True)
class WalkerModel:
    """Parameters of the fitted model.

    Attributes:
        seeing: Network for tracks with an orientation.
        blind: Network for tracks without orientation.
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
        WalkerModelError: If a shape is wrong, a number is not finite, the slope of the decision is not positive, or
            there are at most 2 degrees of freedom.
    """

    seeing: Network
    blind: Network
    log_spread: FloatArray
    hidden: FloatArray = field(default_factory=lambda: np.zeros((N_DOUBT, 0)))
    log_spread_hidden: FloatArray = field(default_factory=lambda: np.zeros((0, KNOTS_S.size, 3)))
    noise_share: FloatArray = field(default_factory=lambda: np.zeros(KNOTS_S.size))
    decision: tuple[float, float] = (1.0, 0.0)
    degrees_of_freedom: float = 5.0
    about: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        knots, units = KNOTS_S.size, self.hidden.shape[1:]
        _check(self.log_spread, "log_spread", (N_DOUBT, knots, 3))
        _check(self.hidden, "hidden", (N_DOUBT, *units))
        _check(self.log_spread_hidden, "log_spread_hidden", (*units, knots, 3))
        _check(self.noise_share, "noise_share", (knots,))
        if not (len(self.decision) == 2 and 0.0 < self.decision[0] < math.inf and math.isfinite(self.decision[1])):
            raise WalkerModelError(f"decision is {self.decision}, expected a positive slope and a threshold")
        if not self.degrees_of_freedom > 2.0:  # below, a t distribution has no covariance
            raise WalkerModelError(f"degrees_of_freedom is {self.degrees_of_freedom}, expected more than 2")

    def outputs(self, network: FloatArray) -> FloatArray:
        """Outputs of the networks.

        Each input is evaluated with its mirror image, so the model is symmetric in left and right. A separate network
        serves tracks without orientation; the outputs of both are blended by the weight of orientation.

        Args:
            network: Inputs of the networks, shape (N_INPUTS,).

        Returns:
            Shape (2, N_OUTPUTS), as `Network` returns them.
        """
        seen = max(network[KNOWN].tolist())
        shares = (self.seeing, seen), (self.blind, 1.0 - seen)
        return sum((share * each(network) for each, share in shares if share > 0.0), np.zeros((2, N_OUTPUTS)))

    def answer(
        self, outputs: FloatArray, spread: FloatArray, places_m: FloatArray, velocities_m_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Departure from the line, and the features of the uncertainty model.

        The forecast is the mixture mean of both regimes: walking, and a critically damped return from the newest
        position to the mean of the places, plus the transient of an initial velocity, the mean of rest and of the
        filters' velocities; both means are weighted by the softmax of their logits.

        Args:
            outputs: Outputs of the networks, shape (2, N_OUTPUTS); in a forecast, with low-pass filtered logits.
            spread: Inputs of the uncertainty model, shape (N_SPREAD,).
            places_m: Candidate places of staying relative to the line's origin, shape (N_PLACES, 3), metres.
            velocities_m_s: Velocities of the line and of the filters along, across and up, shape (N_VELOCITIES, 3),
                m/s.

        Returns:
            Departures, mean over the forecasts for the input and its mirror image, shape (knots, 3), metres along,
            across and up. Features for `spread_m`, shape (N_DOUBT,): `spread`, the size of the departure, half the
            distance between the two forecasts, the distance between the two regimes, and the probability of walking.
        """
        track = np.concatenate([places_m.ravel(), velocities_m_s.ravel(), self.decision])
        departure, doubt = _mixture(outputs.ravel(), track)
        return departure.reshape(KNOTS_S.size, 3), np.concatenate([spread, doubt])

    def spread_m(self, doubt: FloatArray) -> FloatArray:
        """Standard deviation of the forecast errors: scale of the t distribution times the root of v / (v - 2).

        Args:
            doubt: Features of the uncertainty model, shape (N_DOUBT,).

        Returns:
            Shape (knots, 4): metres along, across and up without the observation's stated error; the factor of the
            stated error.
        """
        log_spread = doubt @ self.log_spread.reshape(N_DOUBT, -1)
        log_spread += np.tanh(doubt @ self.hidden) @ self.log_spread_hidden.reshape(-1, 3 * KNOTS_S.size)
        own_m = np.exp(np.minimum(np.maximum(log_spread, _LOG_SPREAD_RANGE[0]), _LOG_SPREAD_RANGE[1])).reshape(-1, 3)
        # Root of v / (v - 2), in a form that is also valid for infinite v, the normal distribution.
        factor = 1.0 / math.sqrt(1.0 - 2.0 / self.degrees_of_freedom)
        return factor * np.concatenate([own_m, self.noise_share[:, None]], axis=1)


@Compiled
@cache
def _mixture() -> ca.Function:
    """Function of outputs and track to the departure and its features, see `WalkerModel.answer`."""
    flat, track = ca.SX.sym("outputs", 2 * N_OUTPUTS), ca.SX.sym("track", 3 * (N_PLACES + N_VELOCITIES) + 2)
    regimes, (slope, threshold) = ca.reshape(track[:-2], 3, -1), ca.vertsplit(track[-2:])
    places_m, line_m_s, velocities_m_s = ca.horzsplit(regimes, [0, N_PLACES, N_PLACES + 1, N_PLACES + N_VELOCITIES])
    columns = ca.vertsplit(flat, N_OUTPUTS)
    begin_m = places_m[:, 0] @ (1.0 - _RETURNED)[None] - line_m_s @ KNOTS_S[None]
    probabilities, means_m, between_m2 = [], [], []
    for column in columns:
        place_m = places_m @ ca.exp(column[PLACES] - ca.logsumexp(column[PLACES]))
        initial_m_s = velocities_m_s @ ca.exp(column[VELOCITIES] - ca.logsumexp(column[VELOCITIES]))[1:]
        stay_m = begin_m + place_m @ _RETURNED[None] + initial_m_s @ TRANSIENT_S[None]
        apart_m = ca.reshape(column[DEPARTURES], 3, KNOTS_S.size) - stay_m
        p = 1.0 / (1.0 + ca.exp(slope * (threshold - column[WALKS])))
        probabilities.append(p)
        means_m.append(stay_m + p * apart_m)
        between_m2.append(p * (1.0 - p) * ca.sumsqr(apart_m[:2, _FAR]))
    departure_m = 0.5 * (means_m[0] + means_m[1])
    sizes_m = ca.vertcat(departure_m[1, _NEAR], departure_m[1, _FAR], departure_m[0, _FAR])
    doubt = ca.vertcat(
        ca.fmin(ca.fabs(sizes_m) / _USUAL_DEPARTURE_M, _LARGEST_SIZE),
        # In the horizontal plane, where turns take place.
        ca.log1p(0.5 * ca.norm_2((means_m[0] - means_m[1])[:2, _FAR]) / _USUAL_DISTANCE_M),
        ca.log1p(ca.sqrt(0.5 * (between_m2[0] + between_m2[1])) / _USUAL_DISTANCE_M),
        0.5 * (probabilities[0] + probabilities[1]),
    )
    return ca.Function("mixture", [flat, track], [ca.vec(departure_m), doubt])


SHIPPED = Path(__file__).with_name("walker.npz")
_WHOLE = ("log_spread", "hidden", "log_spread_hidden", "noise_share", "decision", "degrees_of_freedom")


def save_walker_model(model: WalkerModel, path: Path | IO[bytes]) -> None:
    """Write a model to an `.npz` file.

    Args:
        model: The model.
        path: Path, or open binary file.
    """
    arrays: dict[str, Any] = {name: getattr(model, name) for name in _WHOLE} | {"about": json.dumps(model.about)}
    arrays |= model.seeing.arrays("seeing_") | model.blind.arrays("blind_")
    np.savez_compressed(path, **arrays)


def load_walker_model(path: Path = SHIPPED) -> WalkerModel:
    """Read a model.

    Args:
        path: File written by `save_walker_model`; default: the shipped model.

    Returns:
        The model.

    Raises:
        WalkerModelError: If the file cannot be read or is not a walker model.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            seeing, blind = (Network.of(data, prefix) for prefix in ("seeing_", "blind_"))
            kept: dict[str, Any] = {name: data[name] for name in _WHOLE}
            kept.update(decision=tuple(data["decision"].tolist()), degrees_of_freedom=float(data["degrees_of_freedom"]))
            return WalkerModel(seeing, blind, **kept, about=dict(json.loads(str(data["about"]))))
    except OSError as error:
        raise WalkerModelError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (KeyError, IndexError, TypeError, ValueError, zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise WalkerModelError(f"{path}: not a model of the walker predictor: {error}") from None


@cache
def shipped_walker_model() -> WalkerModel:
    """The shipped model, loaded once a process."""
    return load_walker_model()
