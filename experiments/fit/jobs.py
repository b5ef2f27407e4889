"""The two kinds of jobs of a fit: examples of a recording, and networks for everybody but one person."""

from __future__ import annotations

from dataclasses import dataclass, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from experiments.engine.cache import read_result
from experiments.engine.job import Row
from experiments.engine.keys import key_of, recording_hash
from experiments.fit.examples import Examples, fitting_examples, join, scoring_examples
from experiments.fit.networks import fit_networks
from predictors.walker.network import KNOTS_S, N_DOUBT, WalkerModel

LIBRARIES = ("jax", "jaxlib", "optax")


@dataclass(frozen=True)
class ExamplesJob:
    """Examples of a recording, see `experiments.fit.examples`.

    Attributes:
        recording: Synthetic name or path.
        seed: Seed of all that is random.
        variants: How many variants to fit networks on; 0 for the examples that errors are measured on.
    """

    recording: str
    seed: int
    variants: int

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        content = {"recording": recording_hash(self.recording), "seed": self.seed, "variants": self.variants}
        return key_of(content, *_PROGRAM)

    def run(self) -> Row:
        """The examples, array by array."""
        if self.variants:
            return vars(fitting_examples(self.recording, self.seed, self.variants))
        return vars(scoring_examples(self.recording, self.seed))


@dataclass(frozen=True)
class NetworksJob:
    """Networks fitted on the examples of some recordings, see `experiments.fit.networks.fit_networks`.

    Attributes:
        examples: Files of the results of `ExamplesJob`, which are named by all that they depend on.
        seed: Seed of all that is random.
        networks: How many networks.
        steps: Steps of gradient descent for each.
    """

    examples: tuple[Path, ...]
    seed: int
    networks: int
    steps: int

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        content = {
            "examples": [path.stem for path in self.examples],
            "settings": [self.seed, self.networks, self.steps],
            "versions": [_version(library) for library in LIBRARIES],
        }
        return key_of(content, *_PROGRAM)

    def run(self) -> Row:
        """Weights and biases, layer by layer."""
        examples = join([examples_of(read_result(path)) for path in self.examples])
        weights, biases = fit_networks(examples, self.seed, self.networks, self.steps)
        layers = range(len(weights))
        return {f"weights_{i}": weights[i] for i in layers} | {f"biases_{i}": biases[i] for i in layers}


def examples_of(row: Row) -> Examples:
    """The examples from the result of `ExamplesJob`."""
    return Examples(**{f.name: row[f.name] for f in fields(Examples)})


def model_of(networks: Row, key: str) -> WalkerModel:
    """A model without a fitted uncertainty.

    Args:
        networks: Result of `NetworksJob`.
        key: Its key.

    Returns:
        The model.
    """
    layers = range(sum(name.startswith("weights_") for name in networks))
    weights, biases = (tuple(networks[f"{what}_{i}"] for i in layers) for what in ("weights", "biases"))
    return WalkerModel(weights, biases, np.zeros((N_DOUBT, KNOTS_S.size, 3)), about={"key": key})


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed"


# Modules of the jobs.
_PROGRAM = (
    __name__,
    *(f"experiments.fit.{module}" for module in ("examples", "networks", "pace", "trackers", "variants")),
)
