"""Fit the networks of the predictor `walker` by gradient descent (extra `fit`)."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.fit.examples import Examples
from gazempc.errors import MissingOptionalDependencyError
from predictors.walker.features import N_INPUTS, OF_YAWS
from predictors.walker.network import DEPARTURE_SCALE_M, KNOTS_S

Float32Array = NDArray[np.float32]

HIDDEN = (96, 64)
_BATCH, _LEARNING_RATE, _WEIGHT_DECAY = 512, 2e-3, 0.2
# Errors at the first knot and at the last are of less use than those a neck acts on, 0.1 to 1 s ahead.
_KNOT_WEIGHTS = np.array([0.3, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5])
_USUAL_ERROR_M = np.array([0.02, 0.03, 0.04, 0.06, 0.08, 0.12, 0.18, 0.3])


def fit_networks(
    examples: Examples, seed: int, networks: int, steps: int, sees_yaws: bool = True
) -> tuple[tuple[Float32Array, ...], tuple[Float32Array, ...]]:
    """Fit an ensemble for the least mean distance between forecast and truth.

    Two hidden layers of tanh, AdamW with a cosine schedule.

    Args:
        examples: What to fit on.
        seed: Seed of starting weights and batches.
        networks: How many networks.
        steps: Steps of gradient descent for each.
        sees_yaws: Whether they are shown pelvis and head orientation. Of those that are not, these weights are zero.

    Returns:
        Weights and biases by layer, see `predictors.walker.network.WalkerModel`.

    Raises:
        MissingOptionalDependencyError: If jax or optax is not installed.
    """
    try:
        import jax  # noqa: PLC0415
        import jax.numpy as jnp  # noqa: PLC0415
        import optax  # noqa: PLC0415
    except ImportError:
        raise MissingOptionalDependencyError("fitting a predictor", "jax optax", "fit") from None

    shown = np.arange(N_INPUTS) if sees_yaws else np.setdiff1d(np.arange(N_INPUTS), OF_YAWS)
    x, weight = jnp.asarray(examples.network[:, shown]), jnp.asarray(examples.weight)
    known = jnp.asarray(np.isfinite(examples.departure_m[..., 0]))
    y = jnp.asarray(np.nan_to_num(examples.departure_m))
    scale = jnp.asarray(DEPARTURE_SCALE_M, dtype=jnp.float32)[:, None]
    knot_weights = jnp.asarray(_KNOT_WEIGHTS / _USUAL_ERROR_M, dtype=jnp.float32)
    sizes = (x.shape[1], *HIDDEN, 3 * KNOTS_S.size)
    optimiser = optax.adamw(optax.cosine_decay_schedule(_LEARNING_RATE, steps), weight_decay=_WEIGHT_DECAY)

    def output(layers: Any, batch: Any) -> Any:
        h = batch
        for w, b in layers[:-1]:
            h = jnp.tanh(h @ w + b)
        return (h @ layers[-1][0] + layers[-1][1]).reshape(-1, KNOTS_S.size, 3) * scale

    def loss(layers: Any, rows: Any) -> Any:
        off = output(layers, x[rows]) - y[rows]
        # The constant keeps the gradient of the distance finite at zero.
        distance = jnp.sqrt(jnp.sum(off**2, axis=-1) + 1e-5)
        return jnp.mean(jnp.where(known[rows], distance, 0.0) * weight[rows][:, None] * knot_weights)

    def step(state: Any, key: Any) -> Any:
        layers, memory = state
        rows = jax.random.randint(key, (_BATCH,), 0, x.shape[0])
        updates, memory = optimiser.update(jax.grad(loss)(layers, rows), memory, layers)
        return (optax.apply_updates(layers, updates), memory), None

    @jax.jit
    def fit(layers: Any, key: Any) -> Any:
        return jax.lax.scan(step, (layers, optimiser.init(layers)), jax.random.split(key, steps))[0][0]

    fitted = []
    for k in range(networks):
        rng = np.random.default_rng([seed, k])
        layers = [
            (
                jnp.asarray(
                    rng.standard_normal((a, b)) * (1.0 if i < len(sizes) - 2 else 0.1) / np.sqrt(a), dtype=jnp.float32
                ),
                jnp.zeros(b, dtype=jnp.float32),
            )
            for i, (a, b) in enumerate(pairwise(sizes))
        ]
        found = [(np.asarray(W), np.asarray(b)) for W, b in fit(layers, jax.random.key(1000 * seed + k))]
        first = np.zeros((N_INPUTS, HIDDEN[0]), dtype=np.float32)
        first[shown] = found[0][0]
        fitted.append([(first, found[0][1]), *found[1:]])
    return (
        tuple(np.stack([network[i][0] for network in fitted]) for i in range(len(sizes) - 1)),
        tuple(np.stack([network[i][1][None] for network in fitted]) for i in range(len(sizes) - 1)),
    )
