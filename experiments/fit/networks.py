"""Fit the networks of the predictor `walker` by gradient descent (extra `fit`), and the two kinds of jobs of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from importlib.metadata import distributions
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.engine.engine import read_result
from experiments.engine.job import Row, key_of, recording_hash
from experiments.fit.examples import Examples, fitting_examples, join, scoring_examples
from gazempc.errors import importing
from gazempc.sim.sensor import SensorSpec
from predictors.walker import network as walker
from predictors.walker.features import CORRELATION, LOG_SD, N_INPUTS, NOISE_SCALE_M, OF_YAWS
from predictors.walker.knots import KNOTS_S

Float32Array = NDArray[np.float32]

# Hidden units, chosen together with 280 variants of each recording, with 43 recordings of walking and 7 of standing
# people left out: 96 and 64 units have 5 to 9 % larger errors with precise trackers, at 140 variants as at 280; 384 and
# 256 units reduce errors by at most 2 % and leave eye contact equal within 0.5 points; a second network reduces errors
# by at most 1 %. The number of people matters more: fitted to 7 walking people in place of 14, networks have 3 to 4 %
# larger errors for three others (tracker `reference`, 0.5 s); with other clips of the tested person in the fit, errors
# are 9 to 20 % smaller for five of six people.
HIDDEN = (256, 192)
_BATCH, _LEARNING_RATE, _WEIGHT_DECAY = 512, 2e-3, 0.2
# Initial logits of walking, of the newest position as the place of staying (probability 0.2), and of rest as the
# initial velocity there (0.9).
_BEGINS_WALKING, _BEGINS_NEWEST, _BEGINS_AT_REST = 2.0, 1.0, 4.0
# Regime of staying in the fit: an exponential return with this time constant, seconds. Networks that are fitted with
# the critically damped return of the forecast have 0.9 points less contact with stopping pedestrians (59.6 in place of
# 60.5 %, `body_tracker`, equal seeds; an earlier model).
_RETURN_TIME_S = 0.5
# Lower weights at the ends: necks use the forecast 0.1 to 1 s ahead.
_KNOT_WEIGHTS = np.array([0.3, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5])
_USUAL_ERROR_M = np.array([0.02, 0.03, 0.04, 0.06, 0.08, 0.12, 0.18, 0.3])


def observed_m2(network: NDArray[np.floating[Any]]) -> Float32Array:
    """Covariance of the observed position, recovered from the inputs of the networks.

    Args:
        network: Inputs, shape (N, N_INPUTS).

    Returns:
        Variances along and across, covariance of the two, and variance up, shape (N, 4), square metres.
    """
    along, across, up = NOISE_SCALE_M * np.exp(network[:, LOG_SD].astype(np.float32)).T
    both = along * across * np.clip(network[:, CORRELATION], -1.0, 1.0)
    return np.stack([along**2, across**2, both, up**2], axis=1)


def seen_distance2(off_m: Any, noise_m2: Any, usual_m2: Any) -> Any:
    """Squared norm of forecast errors that discounts directions of large measurement noise.

    Computes e' (I + N / u)^-1 e with error e, covariance N of the observation and typical squared error u. A camera
    measures bearing precisely and range poorly, so the loss weights the error in bearing.

    Args:
        off_m: Errors along, across and up, shape (N, K, 3), metres.
        noise_m2: As returned by `observed_m2`, shape (N, 4).
        usual_m2: Typical squared error at each knot, shape (K,).

    Returns:
        Shape (N, K), square metres. Accepts arrays of NumPy and JAX.
    """
    along, across, up = off_m[..., 0], off_m[..., 1], off_m[..., 2]
    share = noise_m2[:, None, :] / usual_m2[:, None]
    a, c, both = 1.0 + share[..., 0], 1.0 + share[..., 1], share[..., 2]
    level = (c * along**2 - 2.0 * both * along * across + a * across**2) / (a * c - both**2)
    return level + up**2 / (1.0 + share[..., 3])


def fit_network(examples: Examples, seed: int, steps: int, sees_yaws: bool = True) -> walker.Network:
    """Fit a network that minimises the mean norm of the forecast error, see `seen_distance2`.

    Two hidden tanh layers; AdamW with a cosine learning-rate schedule.

    Args:
        examples: Training examples.
        seed: Seed of initial weights and batches.
        steps: Gradient steps.
        sees_yaws: Whether pelvis and head orientation are inputs; otherwise their weights are zero.

    Returns:
        The network.

    Raises:
        MissingOptionalDependencyError: If jax or optax is not installed.
    """
    with importing("fitting a predictor", "jax optax", "fit"):
        import jax  # noqa: PLC0415
        import jax.numpy as jnp  # noqa: PLC0415
        import optax  # noqa: PLC0415

    columns = np.arange(N_INPUTS) if sees_yaws else np.setdiff1d(np.arange(N_INPUTS), OF_YAWS)
    # An argument: constants that a compiled function closes over would be copied, here gigabytes.
    table = (
        jnp.asarray(examples.network[:, columns]),
        jnp.asarray(np.nan_to_num(examples.departure_m)),
        jnp.asarray(np.isfinite(examples.departure_m[..., 0])),
        jnp.asarray(examples.weight),
        jnp.asarray(observed_m2(examples.network)),
        jnp.asarray(examples.places_m),
        jnp.asarray(examples.velocities_m_s),
    )
    n, usual_m2 = len(examples.weight), jnp.asarray(_USUAL_ERROR_M**2, dtype=jnp.float32)
    scale = jnp.asarray(walker.DEPARTURE_SCALE_M, dtype=jnp.float32)[:, None]
    knot_weights = jnp.asarray(_KNOT_WEIGHTS / _USUAL_ERROR_M, dtype=jnp.float32)
    sizes = (columns.size, *HIDDEN, walker.N_OUTPUTS)
    optimiser = optax.adamw(optax.cosine_decay_schedule(_LEARNING_RATE, steps), weight_decay=_WEIGHT_DECAY)

    knots_s = jnp.asarray(KNOTS_S, dtype=jnp.float32)[:, None]
    returned = 1.0 - jnp.exp(-knots_s / _RETURN_TIME_S)
    transient_s = jnp.asarray(walker.TRANSIENT_S, dtype=jnp.float32)[:, None]

    def output(layers: Any, h: Any, places_m: Any, velocities_m_s: Any) -> Any:
        for w, b in layers[:-1]:
            h = jnp.tanh(h @ w + b)
        answers = h @ layers[-1][0] + layers[-1][1]
        departures = answers[:, walker.DEPARTURES].reshape(-1, KNOTS_S.size, 3) * scale
        walks = 1.0 / (1.0 + jnp.exp(-answers[:, walker.WALKS]))
        place_m = jax.nn.softmax(answers[:, walker.PLACES])[:, None] @ places_m
        initial_m_s = jax.nn.softmax(answers[:, walker.VELOCITIES])[:, None, 1:] @ velocities_m_s[:, 1:]
        stays = (1.0 - returned) * places_m[:, :1] - knots_s * velocities_m_s[:, :1]
        stays += returned * place_m + transient_s * initial_m_s
        return walks[:, None, None] * departures + (1.0 - walks)[:, None, None] * stays

    def loss(layers: Any, batch: Any) -> Any:
        x, y, known, weight, noise_m2, places_m, velocities_m_s = batch
        off = output(layers, x.astype(jnp.float32), places_m, velocities_m_s) - y
        # The constant keeps the gradient of the square root finite at zero.
        distance = jnp.sqrt(seen_distance2(off, noise_m2, usual_m2) + 1e-5)
        return jnp.mean(jnp.where(known, distance, 0.0) * weight[:, None] * knot_weights)

    @jax.jit
    def fit(layers: Any, table: Any, key: Any) -> Any:
        def step(state: Any, key: Any) -> Any:
            layers, memory = state
            rows = jax.random.randint(key, (_BATCH,), 0, n)
            batch = tuple(column[rows] for column in table)
            updates, memory = optimiser.update(jax.grad(loss)(layers, batch), memory, layers)
            return (optax.apply_updates(layers, updates), memory), None

        return jax.lax.scan(step, (layers, optimiser.init(layers)), jax.random.split(key, steps))[0][0]

    initial_logits = np.zeros(walker.N_OUTPUTS)
    outputs = [walker.WALKS, walker.PLACES.start, walker.VELOCITIES.start]
    initial_logits[outputs] = _BEGINS_WALKING, _BEGINS_NEWEST, _BEGINS_AT_REST
    rng = np.random.default_rng([seed, 0])  # with the key below, the streams of the shipped model
    layers = []
    for i, (a, b) in enumerate(pairwise(sizes)):
        is_last = i == len(HIDDEN)
        start = rng.standard_normal((a, b)) * (0.1 if is_last else 1.0) / np.sqrt(a)
        biases_at_start = initial_logits if is_last else np.zeros(b)
        layers.append(tuple(jnp.asarray(each, dtype=jnp.float32) for each in (start, biases_at_start)))
    weights, biases = zip(*fit(layers, table, jax.random.key(1000 * seed)), strict=True)
    first = np.zeros((N_INPUTS, HIDDEN[0]), dtype=np.float32)
    first[columns] = weights[0]
    return walker.Network((first, *map(np.asarray, weights[1:])), tuple(map(np.asarray, biases)))


_LIBRARIES = ("jax", "jaxlib", "optax")
# Slope and threshold of the decision between walking and staying. Chosen on standing, waiting, starting and stopping
# people left out of the fit; `docs/predictors.md` has the trade-off over the threshold.
_DECISION = (1.5, 0.35)


@dataclass(frozen=True)
class ExamplesJob:
    """Examples of a recording, see `experiments.fit.examples`.

    Attributes:
        recording: Synthetic name or path.
        seed: Seed of the random generator.
        variants: Number of variants for a fit; 0 for test examples.
        tracker: The only tracker; None for trackers drawn at random.
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
class NetworkJob:
    """A network fitted to the examples of some recordings, see `fit_network`.

    Attributes:
        examples: Result files of `ExamplesJob`, named by a hash of their dependencies.
        seed: Seed of initial weights and batches.
        steps: Gradient steps.
        sees_yaws: Whether orientations are inputs.
    """

    examples: tuple[Path, ...]
    seed: int
    steps: int
    sees_yaws: bool

    def key(self) -> str:
        """See `experiments.engine.job.Job`."""
        names = [path.stem for path in self.examples]
        installed = {name: d.version for name in _LIBRARIES for d in distributions(name=name)}
        return key_of(self, examples=names, versions=installed)

    def run(self) -> Row:
        """Weights and biases, layer by layer."""
        examples = join([examples_of(read_result(path)) for path in self.examples])
        return fit_network(examples, self.seed, self.steps, self.sees_yaws).arrays()


def examples_of(row: Row) -> Examples:
    """Examples from a result of `ExamplesJob`."""
    return Examples(**{f.name: row[f.name] for f in fields(Examples)})


def model_of(networks: Sequence[Row], key: str) -> walker.WalkerModel:
    """A model with fitted networks and a zero uncertainty model.

    Args:
        networks: Results of `NetworkJob`: with orientations, and without.
        key: Key of the first.

    Returns:
        The model.
    """
    seeing, blind = map(walker.Network.of, networks)
    no_spread = np.zeros((walker.N_DOUBT, KNOTS_S.size, 3))
    return walker.WalkerModel(seeing, blind, no_spread, decision=_DECISION, about={"key": key})
