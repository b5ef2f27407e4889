"""Serialisation of a walker model: saved by a fit, loaded by the predictor."""

from __future__ import annotations

import json
import zipfile
import zlib
from functools import cache
from pathlib import Path
from typing import IO, Any

import numpy as np

from predictors.walker.network import Network, WalkerModel, WalkerModelError

SHIPPED = Path(__file__).with_name("walker.npz")
_NETWORKS = ("seeing", "blind")
_WHOLE = ("log_spread", "hidden", "log_spread_hidden", "noise_share", "decision", "degrees_of_freedom")


def save_walker_model(model: WalkerModel, path: Path | IO[bytes]) -> None:
    """Write a model to an `.npz` file.

    Args:
        model: The model.
        path: Path, or open binary file.
    """
    arrays: dict[str, Any] = {name: getattr(model, name) for name in _WHOLE} | {"about": json.dumps(model.about)}
    for name in _NETWORKS:
        for what, layers in vars(getattr(model, name)).items():
            arrays |= {f"{name}_{what}_{i}": layer.astype(np.float32) for i, layer in enumerate(layers)}
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
            layers = range(sum(name.startswith("seeing_weights_") for name in data.files))
            seeing, blind = (
                Network(*(tuple(data[f"{name}_{what}_{i}"] for i in layers) for what in ("weights", "biases")))
                for name in _NETWORKS
            )
            whole: dict[str, Any] = {name: data[name] for name in _WHOLE}
            decision, freedom = tuple(data["decision"].tolist()), float(data["degrees_of_freedom"])
            whole |= {"decision": decision, "degrees_of_freedom": freedom}
            return WalkerModel(seeing, blind, **whole, about=dict(json.loads(str(data["about"]))))
    except OSError as error:
        raise WalkerModelError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (KeyError, IndexError, TypeError, ValueError, zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise WalkerModelError(f"{path}: not a model of the walker predictor: {error}") from None


@cache
def shipped_walker_model() -> WalkerModel:
    """The shipped model, loaded once a process."""
    return load_walker_model()
