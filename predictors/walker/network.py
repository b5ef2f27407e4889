"""The fitted numbers of `Walker`: a small ensemble of networks, and how far it errs."""

from __future__ import annotations

import json
import math
import zipfile
import zlib
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from predictors.types import FloatArray
from predictors.walker.features import MIRROR, N_INPUTS, N_SPREAD
from predictors.walker.optional import compiled

Float32Array = NDArray[np.float32]

# Steps at which the networks say how the walk will leave the line; a cubic spline runs through them.
KNOTS_S = np.array([0.0, 0.125, 0.25, 0.375, 0.5, 0.75, 1.0, 1.5])
_LAST_KNOT_S = float(KNOTS_S[-1])
# What a departure from the line is like at each knot; the networks' outputs are of order one.
DEPARTURE_SCALE_M = np.array([0.015, 0.02, 0.03, 0.045, 0.06, 0.1, 0.15, 0.25])
SHIPPED = Path(__file__).with_name("walker.npz")
_LOG_SPREAD_RANGE = (math.log(0.002), math.log(5.0))  # metres
# Reasons for doubt beside the inputs: size of the departure across at 0.5 s, across and along at 1 s; disagreement.
N_DOUBT = N_SPREAD + 4
_NEAR, _FAR = 4, 6
_USUAL_DEPARTURE_M = np.array([0.06, 0.2, 0.2])
_USUAL_DISAGREEMENT_M = 0.02
_MIRRORED = np.array([1.0, -1.0, 1.0])
# Beyond the last knot the error grows as that of a velocity that wanders at random.
_GROWTH = 1.5


class WalkerModelError(ValueError):
    """A file is no model of `Walker`."""


@dataclass(frozen=True)
class WalkerModel:
    """Fitted numbers.

    Attributes:
        weights: One array a layer, shape (E, inputs, outputs): E networks side by side.
        biases: One array a layer, shape (E, 1, outputs).
        log_spread: Coefficients of the logarithm of the errors' scale (m) at each knot along, across and up, shape
            (N_DOUBT, knots, 3); the error of the observation is not in it.
        noise_share: How much of one observation's error is in the forecast at each knot, shape (2, knots): a factor of
            its standard deviation, whatever its direction, as measured and as stated.
        degrees_of_freedom: Those of the t distribution of the errors, above 2.
        about: Where the numbers are from: recordings, people, command, versions, errors on people left out.

    Raises:
        WalkerModelError: If a shape is wrong or a number is not finite.
    """

    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    log_spread: FloatArray
    noise_share: FloatArray = field(default_factory=lambda: np.zeros((2, KNOTS_S.size)))
    degrees_of_freedom: float = 5.0
    about: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n_out = 3 * KNOTS_S.size
        if not self.weights or len(self.weights) != len(self.biases):
            raise WalkerModelError("a network needs one bias a layer")
        ensemble = self.weights[0].shape[0] if self.weights[0].ndim else 0
        n = N_INPUTS
        for w, b in zip(self.weights, self.biases, strict=True):
            if w.ndim != 3 or w.shape[:2] != (ensemble, n) or b.shape != (ensemble, 1, w.shape[2]):
                raise WalkerModelError(f"layer of shape {w.shape} with bias {b.shape} does not take {n} inputs")
            n = w.shape[2]
        spreads = self.log_spread.shape, self.noise_share.shape
        if n != n_out or spreads != ((N_DOUBT, KNOTS_S.size, 3), (2, KNOTS_S.size)):
            raise WalkerModelError(f"{n} outputs and spread {spreads} do not fit {KNOTS_S.size} knots")
        finite = [bool(np.isfinite(a).all()) for a in (*self.weights, *self.biases)]
        if not (all(finite) and np.isfinite(self.log_spread).all() and np.isfinite(self.noise_share).all()):
            raise WalkerModelError("a number is not finite")
        if not self.degrees_of_freedom > 2.0:  # below, a t distribution has no covariance
            raise WalkerModelError(f"degrees_of_freedom is {self.degrees_of_freedom}, expected more than 2")

    @cached_property
    def _first_layers(self) -> Float32Array:
        return np.concatenate(list(self.weights[0]), axis=1)

    def answer(self, network: FloatArray, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How the walk will leave its line, and what there is to say about how sure that is.

        Each walk is asked about twice, as it is and mirrored, so that left and right are treated alike.

        Args:
            network: Inputs of the network, shape (N, N_INPUTS).
            spread: Inputs of the uncertainty, shape (N, N_SPREAD).

        Returns:
            Departures, mean over the ensemble and both questions, shape (N, knots, 3), metres along, across and up.
            Reasons for doubt for `spread_m`, shape (N, N_DOUBT): the given ones, the size of the departure, and how far
            the networks disagree.
        """
        # The first layers take the same inputs: one product for all networks, which is most of the work.
        ensemble, _, hidden = self.weights[0].shape
        questions = np.empty((2 * len(network), N_INPUTS), dtype=np.float32)
        questions[: len(network)] = network
        np.multiply(network, MIRROR, out=questions[len(network) :], casting="same_kind")
        first = questions @ self._first_layers
        h = first.reshape(-1, ensemble, hidden).transpose(1, 0, 2) + self.biases[0]
        for w, b in zip(self.weights[1:], self.biases[1:], strict=True):
            h = np.tanh(h) @ w + b
        answers = h.reshape(ensemble, 2, len(network), KNOTS_S.size, 3).astype(np.float64)
        answers[:, 1] *= _MIRRORED
        answers = answers.reshape(2 * ensemble, len(network), KNOTS_S.size, 3)
        mean = np.add.reduce(answers, axis=0) / (2 * ensemble)
        departure = mean * DEPARTURE_SCALE_M[:, None]
        # How far the answers lie apart, in the horizontal plane, where turns are foreseen or not.
        off = answers[:, :, _FAR, :2] - mean[:, _FAR, :2]
        apart = np.sqrt(np.einsum("eni,eni->n", off, off) / (2 * ensemble)) * DEPARTURE_SCALE_M[_FAR]
        doubt = np.empty((len(network), N_DOUBT))
        doubt[:, :N_SPREAD] = spread
        size = doubt[:, N_SPREAD:-1]
        size[:, :2], size[:, 2] = departure[:, _NEAR : _FAR + 1 : _FAR - _NEAR, 1], departure[:, _FAR, 0]
        np.minimum(np.abs(size) / _USUAL_DEPARTURE_M, 4.0, out=size)
        doubt[:, -1] = np.log1p(apart / _USUAL_DISAGREEMENT_M)
        return departure, doubt

    def spread_m(self, doubt: FloatArray) -> FloatArray:
        """Standard deviation of the errors: of a t distribution, that is its scale times the root of v / (v - 2).

        Args:
            doubt: Reasons for doubt, shape (N, N_DOUBT).

        Returns:
            Shape (N, knots, 5): metres along, across and up without the observations' error; the factors of that error,
            as measured and as stated.
        """
        log_spread = doubt @ self.log_spread.reshape(N_DOUBT, -1)
        bounded = np.minimum(np.maximum(log_spread, _LOG_SPREAD_RANGE[0]), _LOG_SPREAD_RANGE[1])
        spread = np.empty((len(doubt), KNOTS_S.size, 5))
        np.exp(bounded.reshape(-1, KNOTS_S.size, 3), out=spread[..., :3])
        spread[..., 3:] = self.noise_share.T
        spread /= math.sqrt(1.0 - 2.0 / self.degrees_of_freedom)  # so written, it holds of a normal distribution, too
        return spread

    def save(self, path: Path) -> None:
        """Write the model to an `.npz` file.

        Args:
            path: The file.
        """
        arrays: dict[str, Any] = {
            "log_spread": self.log_spread,
            "noise_share": self.noise_share,
            "degrees_of_freedom": np.array(self.degrees_of_freedom),
            "about": np.array(json.dumps(self.about)),
        }
        for i, (w, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays[f"weights_{i}"], arrays[f"biases_{i}"] = w.astype(np.float32), b.astype(np.float32)
        np.savez_compressed(path, **arrays)


def load_walker_model(path: Path = SHIPPED) -> WalkerModel:
    """Read a model.

    Args:
        path: File written by `WalkerModel.save`; without it the one that ships with the package.

    Returns:
        The model.

    Raises:
        WalkerModelError: If the file cannot be read or is no such model.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            layers = sum(name.startswith("weights_") for name in data.files)
            about = json.loads(str(data["about"]))
            if not isinstance(about, dict):
                raise WalkerModelError("'about' is no mapping")
            return WalkerModel(
                tuple(data[f"weights_{i}"] for i in range(layers)),
                tuple(data[f"biases_{i}"] for i in range(layers)),
                data["log_spread"],
                data["noise_share"],
                float(data["degrees_of_freedom"]),
                about,
            )
    except OSError as error:
        raise WalkerModelError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (KeyError, IndexError, TypeError, ValueError, zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise WalkerModelError(f"{path}: not a model of the walker predictor: {error}") from None


@cache
def shipped_walker_model() -> WalkerModel:
    """The model that ships with the package, read once a process."""
    return load_walker_model()


def model_file(fitted: Path, person: str) -> Path:
    """Which fitted model to use for a person.

    Args:
        fitted: A model, or the folder that `python -m experiments.fit` wrote.
        person: Whose walk is to be forecast.

    Returns:
        The file itself; of a folder, the model that has not seen this person, else the one fitted on everybody.

    Raises:
        WalkerModelError: If there is none.
    """
    if not fitted.is_dir():
        return fitted
    left_out = fitted / "left_out" / f"{person}.npz"
    path = left_out if left_out.is_file() else fitted / "walker.npz"
    if not path.is_file():
        raise WalkerModelError(f"{fitted}: no walker.npz in this folder; accepted: a folder that experiments.fit wrote")
    return path


_SPLINE = CubicSpline(KNOTS_S, np.eye(KNOTS_S.size))
_END_SLOPE = (_SPLINE(KNOTS_S[-1]) - _SPLINE(KNOTS_S[-2])) / (KNOTS_S[-1] - KNOTS_S[-2])
# Weights of the knots every millisecond, as a table: reading it takes a tenth of the time of evaluating the spline, and
# straight lines from one millisecond to the next are off by less than 1e-5 of the values.
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
        spread_m: Standard deviations at the knots, shape (knots, columns), such as `WalkerModel.spread_m` gives.
    """

    def __init__(self, departure_m: FloatArray, spread_m: FloatArray) -> None:
        # Side by side, so that one product with both sets of weights gives both.
        self._values = np.zeros((2 * KNOTS_S.size, 3 + spread_m.shape[1]))
        self._values[: KNOTS_S.size, :3] = departure_m
        np.maximum.accumulate(spread_m, axis=0, out=self._values[KNOTS_S.size :, 3:])

    def __call__(self, tau_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Look up horizons.

        Args:
            tau_s: Horizons, shape (H,), seconds.

        Returns:
            Departures, shape (H, 3): a cubic spline between the knots, held before the first, straight on after the
            last. Standard deviations, shape (H, columns): linear between the knots, never falling with the horizon, and
            after the last growing as that of a velocity which wanders at random; as large for the past as for the same
            time ahead.
        """
        past = bool(np.minimum.reduce(tau_s, initial=0.0) < 0.0)
        away_s = np.abs(tau_s) if past else tau_s
        beyond = bool(np.maximum.reduce(away_s, initial=0.0) > _LAST_KNOT_S)
        if not (past or beyond) and (loops := compiled()) is not None:
            found: tuple[FloatArray, FloatArray] = loops.between_knots(tau_s, _TABLE, _TABLE_STEP_S, self._values)
            return found
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
