"""The two kinds of jobs of a fit: examples of a recording, and networks for everybody but one person."""

from __future__ import annotations

from dataclasses import dataclass, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from experiments.engine.cache import read_result
from experiments.engine.job import Row, key_of, recording_hash
from experiments.fit.examples import Examples, fitting_examples, join, scoring_examples
from experiments.fit.networks import fit_networks
from gazempc.sim.sensor import SensorSpec
from predictors.walker.network import KNOTS_S, N_DOUBT, WalkerModel

LIBRARIES = ("jax", "jaxlib", "optax")
# Slope and threshold of the decision between walking and staying. Chosen on standing and starting people left out of
# the fit; `docs/predictors.md` has the trade-off over the threshold.
_DECISION = (2.5, 1.0)


@dataclass(frozen=True)
class ExamplesJob:
    """Examples of a recording, see `experiments.fit.examples`.

    Attributes:
        recording: Synthetic name or path.
        seed: Seed of all that is random.
        variants: How many variants to fit networks on; 0 for the examples that errors are measured on.
        tracker: The tracker that all walks are seen through; None for many.
    """

    recording: str
    seed: int
    variants: int
    tracker: SensorSpec | None

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        return key_of(self, recording=recording_hash(self.recording))

    def run(self) -> Row:
        """The examples, array by array."""
        if self.variants:
            return vars(fitting_examples(self.recording, self.seed, self.variants, self.tracker))
        return vars(scoring_examples(self.recording, self.seed, self.tracker))


@dataclass(frozen=True)
class NetworksJob:
    """Networks fitted on the examples of some recordings, see `experiments.fit.networks.fit_networks`.

    Attributes:
        examples: Files of the results of `ExamplesJob`, which are named by all that they depend on.
        seed: Seed of all that is random.
        networks: How many networks.
        steps: Steps of gradient descent for each.
        sees_yaws: Whether they are shown orientations.
    """

    examples: tuple[Path, ...]
    seed: int
    networks: int
    steps: int
    sees_yaws: bool

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        names, versions = [path.stem for path in self.examples], [_version(library) for library in LIBRARIES]
        return key_of(self, examples=names, versions=versions)

    def run(self) -> Row:
        """Weights and biases, layer by layer."""
        examples = join([examples_of(read_result(path)) for path in self.examples])
        weights, biases = fit_networks(examples, self.seed, self.networks, self.steps, self.sees_yaws)
        layers = range(len(weights))
        return {f"weights_{i}": weights[i] for i in layers} | {f"biases_{i}": biases[i] for i in layers}


def examples_of(row: Row) -> Examples:
    """The examples from the result of `ExamplesJob`."""
    return Examples(**{f.name: row[f.name] for f in fields(Examples)})


def model_of(seeing: Row, blind: Row, key: str) -> WalkerModel:
    """A model without a fitted uncertainty.

    Args:
        seeing: Result of `NetworksJob` with orientations.
        blind: Its result without.
        key: Key of the first.

    Returns:
        The model.
    """
    layers = range(sum(name.startswith("weights_") for name in seeing))
    weights, biases, blind_weights, blind_biases = (
        tuple(row[f"{what}_{i}"] for i in layers) for row in (seeing, blind) for what in ("weights", "biases")
    )
    no_spread = np.zeros((N_DOUBT, KNOTS_S.size, 3))
    return WalkerModel(weights, biases, blind_weights, blind_biases, no_spread, decision=_DECISION, about={"key": key})


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed"
