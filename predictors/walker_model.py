"""The fitted numbers of `Walker`: a small ensemble of networks, and how far it errs."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from predictors.types import FloatArray
from predictors.walker_inputs import N_INPUTS, N_SPREAD

Float32Array = NDArray[np.float32]

# Steps at which the networks say how the walk will leave the line; a cubic spline runs through them.
KNOTS_S = np.array([0.0, 0.125, 0.25, 0.375, 0.5, 0.75, 1.0, 1.5])
# What a departure from the line is like at each knot; the networks' outputs are of order one.
DEPARTURE_SCALE_M = np.array([0.015, 0.02, 0.03, 0.045, 0.06, 0.1, 0.15, 0.25])
SHIPPED = Path(__file__).with_name("walker.npz")
_SPREAD_RANGE_M = (0.002, 5.0)
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
        log_spread: Coefficients of the logarithm of the standard deviation (m) at each knot along, across and up, shape
            (N_SPREAD, knots, 3).
        about: Where the numbers are from: recordings, people, command, versions, errors on people left out.

    Raises:
        WalkerModelError: If a shape is wrong or a number is not finite.
    """

    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    log_spread: FloatArray
    about: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n_out = 3 * KNOTS_S.size
        if not self.weights or len(self.weights) != len(self.biases):
            raise WalkerModelError("a network needs one bias a layer")
        ensemble = self.weights[0].shape[0]
        n = N_INPUTS
        for W, b in zip(self.weights, self.biases, strict=True):
            if W.ndim != 3 or W.shape[:2] != (ensemble, n) or b.shape != (ensemble, 1, W.shape[2]):
                raise WalkerModelError(f"layer of shape {W.shape} with bias {b.shape} does not take {n} inputs")
            n = W.shape[2]
        if n != n_out or self.log_spread.shape != (N_SPREAD, KNOTS_S.size, 3):
            raise WalkerModelError(f"{n} outputs and spread {self.log_spread.shape} do not fit {KNOTS_S.size} knots")
        if not all(np.all(np.isfinite(a)) for a in (*self.weights, *self.biases, self.log_spread)):
            raise WalkerModelError("a number is not finite")

    def departure_m(self, network: FloatArray) -> FloatArray:
        """How the walk will leave its line.

        Args:
            network: Inputs, shape (N, N_INPUTS).

        Returns:
            Mean over the ensemble, shape (N, knots, 3), metres along, across and up.
        """
        h = network.astype(np.float32)[None]
        for W, b in zip(self.weights[:-1], self.biases[:-1], strict=True):
            h = np.tanh(h @ W + b)
        out = (h @ self.weights[-1] + self.biases[-1]).mean(axis=0)
        return out.reshape(len(network), KNOTS_S.size, 3).astype(np.float64) * DEPARTURE_SCALE_M[:, None]

    def spread_m(self, spread: FloatArray) -> FloatArray:
        """Standard deviation of the forecast.

        Args:
            spread: Inputs, shape (..., N_SPREAD).

        Returns:
            Shape (..., knots, 3), metres along, across and up.
        """
        return np.clip(np.exp(np.tensordot(spread, self.log_spread, axes=1)), *_SPREAD_RANGE_M)

    def save(self, path: Path) -> None:
        """Write the model to an `.npz` file.

        Args:
            path: The file.
        """
        arrays: dict[str, Any] = {"log_spread": self.log_spread, "about": np.array(json.dumps(self.about))}
        for i, (W, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays[f"weights_{i}"], arrays[f"biases_{i}"] = W.astype(np.float32), b.astype(np.float32)
        np.savez_compressed(path, **arrays)


@cache
def load_walker_model(path: Path = SHIPPED) -> WalkerModel:
    """Read a model.

    Args:
        path: File written by `WalkerModel.save`; without it the one that ships with the package.

    Returns:
        The model; read once a process.

    Raises:
        WalkerModelError: If the file cannot be read or is no such model.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            layers = sum(name.startswith("weights_") for name in data.files)
            return WalkerModel(
                tuple(data[f"weights_{i}"] for i in range(layers)),
                tuple(data[f"biases_{i}"] for i in range(layers)),
                data["log_spread"],
                json.loads(str(data["about"])),
            )
    except OSError as error:
        raise WalkerModelError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (KeyError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise WalkerModelError(f"{path}: not a model of the walker predictor: {error}") from None


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


def between_knots(tau_s: FloatArray) -> FloatArray:
    """Matrix that takes values at the knots to values at any horizon.

    A cubic spline between the knots, held before the first, straight on after the last.

    Args:
        tau_s: Horizons, shape (H,), seconds.

    Returns:
        Shape (H, knots).
    """
    inside = np.clip(tau_s, KNOTS_S[0], KNOTS_S[-1])
    return np.asarray(_SPLINE(inside) + np.outer(np.maximum(tau_s - KNOTS_S[-1], 0.0), _END_SLOPE))


def spread_between_knots(tau_s: FloatArray, spread_m: FloatArray) -> FloatArray:
    """Standard deviations at any horizon.

    Args:
        tau_s: Horizons, shape (H,), seconds.
        spread_m: Standard deviations at the knots, shape (knots, 3).

    Returns:
        Shape (H, 3): linear between the knots and never falling with the horizon.
    """
    rising = np.maximum.accumulate(spread_m, axis=0)
    at = np.stack([np.interp(tau_s, KNOTS_S, rising[:, i]) for i in range(3)], axis=1)
    return np.asarray(at * np.maximum(tau_s / KNOTS_S[-1], 1.0)[:, None] ** _GROWTH)
