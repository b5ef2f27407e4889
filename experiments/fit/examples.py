"""Questions and answers to fit the predictor `walker` on: what it reads at a frame, and how the walk went on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from experiments.fit.variants import GaplessWalk, bend, vary, walk_of
from gazempc.errors import GazempcError
from gazempc.recordings.load import load
from predictors import HeadObservation
from predictors.walker.features import N_INPUTS
from predictors.walker.network import KNOTS_S, N_DOUBT, WalkerModel
from predictors.walker.predictor import Walker

# Sensors from perfect to twice as noisy as the reference; yaw noise goes with it, 2 deg for 10 mm.
_NOISES_M = (0.0, 0.0, 0.0025, 0.005, 0.01, 0.01, 0.01, 0.015, 0.02)
_YAW_NOISE_RAD_PER_M = np.radians(200.0)
_YAW_NOISE_FACTORS = (0.5, 1.0, 1.0, 1.0, 1.5)
# How far forecasts err is measured without noise and with that of the reference sensor.
_SCORED_NOISES_M = (0.0, 0.01)
# Errors in real turns are larger than in bent walks, and real turns are rare in recordings.
_SCORED_BENT_WEIGHT, _SCORED_TURNING_WEIGHT = 0.5, 3.0
_HIDDEN: tuple[dict[str, Any], ...] = (
    {"head_quat_wxyz": None},
    {"pelvis_quat_wxyz": None},
    {"head_quat_wxyz": None, "pelvis_quat_wxyz": None},
)
# Only its inputs are used here, so that a model can be fitted where there is none yet.
_BLANK = WalkerModel(
    (np.zeros((1, N_INPUTS, 3 * KNOTS_S.size), dtype=np.float32),),
    (np.zeros((1, 1, 3 * KNOTS_S.size), dtype=np.float32),),
    np.zeros((N_DOUBT, KNOTS_S.size, 3)),
)
# Bent walks outnumber the others: with less weight, turns of people left out are forecast worse, and straight walks no
# better. Turns that were recorded are of few people; with more weight, straight walks of others get worse.
_BENT_WEIGHT, _TURNING_WEIGHT = 2.0, 0.5


@dataclass(frozen=True)
class Examples:
    """Examples of one recording or many, in rows.

    Attributes:
        network: Inputs of the network, shape (N, N_INPUTS).
        spread: Inputs of the stated uncertainty, shape (N, N_SPREAD).
        departure_m: How the walk left its line, shape (N, knots, 3), along, across, up; NaN after its end.
        weight: How much each counts, shape (N,).
    """

    network: NDArray[np.float32]
    spread: NDArray[np.float32]
    departure_m: NDArray[np.float32]
    weight: NDArray[np.float32]


def join(parts: list[Examples]) -> Examples:
    """Examples of many recordings in one table."""
    return Examples(
        np.concatenate([p.network for p in parts]),
        np.concatenate([p.spread for p in parts]),
        np.concatenate([p.departure_m for p in parts]),
        np.concatenate([p.weight for p in parts]),
    )


def _joined(parts: list[Examples], name: str) -> Examples:
    known = [p for p in parts if p.weight.size]
    if not known:
        raise GazempcError(f"{name}: nobody walks in it (0.2 to 3 m/s), so nothing can be fitted on it: leave it out")
    return join(known)


def as_seen(
    walk: GaplessWalk, noise_m: float, yaw_noise_rad: float, rng: np.random.Generator, faults: bool
) -> list[HeadObservation]:
    """Observations of a walk.

    Args:
        walk: The walk.
        noise_m: Standard deviation of the positions on each axis.
        yaw_noise_rad: Standard deviation of the yaws.
        rng: Where chance comes from.
        faults: Whether frames, a stretch of them or orientations may be missing.

    Returns:
        The observations.
    """
    n = walk.times_s.size
    positions = walk.head_m + noise_m * rng.standard_normal((n, 3))
    halves = 0.5 * np.stack([walk.head_yaw_rad, walk.pelvis_yaw_rad])
    halves = halves + 0.5 * yaw_noise_rad * rng.standard_normal((2, n))
    quats = np.zeros((2, n, 4))
    quats[..., 0], quats[..., 3] = np.cos(halves), np.sin(halves)
    kept = np.ones(n, dtype=bool)
    oriented = np.ones((2, n), dtype=bool)
    if faults:
        fault = rng.random()
        if fault < 0.1:
            kept = rng.random(n) > rng.uniform(0.05, 0.5)
        elif fault < 0.2:
            begin_s = rng.uniform(walk.times_s[0] + 0.3, walk.times_s[-1])
            kept = (walk.times_s < begin_s) | (walk.times_s > begin_s + rng.uniform(0.2, 1.0))
        fault = rng.random()
        if fault < 0.05:
            oriented[:] = False
        elif fault < 0.15:
            oriented[rng.integers(2)] = False
    return [
        HeadObservation(
            float(walk.times_s[k]),
            positions[k],
            quats[0, k] if oriented[0, k] else None,
            quats[1, k] if oriented[1, k] else None,
        )
        for k in range(n)
        if kept[k]
    ]


def examples_of_walk(walk: GaplessWalk, observations: list[HeadObservation], weight: float) -> Examples:
    """What `Walker` reads at each frame of a walk, and how the walk went on.

    Args:
        walk: The true walk.
        observations: What is seen of it.
        weight: Weight of each example; frames at which nobody walks count less.

    Returns:
        The examples.
    """
    truth = CubicSpline(walk.times_s, walk.head_m)
    walker = Walker(_BLANK)
    network, spread, departure, weights = [], [], [], []
    for observation in observations:
        walker.update(observation)
        inputs = walker.inputs()
        if inputs.time_s != observation.capture_time_s or inputs.walking == 0.0:
            continue
        ahead_s = inputs.time_s + KNOTS_S
        c, s = np.cos(inputs.heading_rad), np.sin(inputs.heading_rad)
        off = truth(ahead_s) - inputs.origin_base_m - KNOTS_S[:, None] * inputs.velocity_base_m_s
        off = np.stack([c * off[:, 0] + s * off[:, 1], c * off[:, 1] - s * off[:, 0], off[:, 2]], axis=1)
        off[ahead_s > walk.times_s[-1] + 1e-6] = np.nan
        network.append(inputs.network)
        spread.append(inputs.spread)
        departure.append(off)
        weights.append(weight * inputs.walking)
    return Examples(
        *(np.array(a, dtype=np.float32) for a in (network, spread, departure, weights)),
    )


def fitting_examples(path: str, seed: int, variants: int) -> Examples:
    """Examples of a recording and its variants.

    Args:
        path: Name or path of the recording.
        seed: Seed of all that is random, with the recording's name.
        variants: How many variants to make: two in five unbent, three in five bent; of a walk that turns by itself, the
            unbent ones only.

    Returns:
        The examples.

    Raises:
        GazempcError: If the recording cannot be read, is too short, or nobody walks in it.
    """
    name, walk, rng = _walk_and_chance(path, seed)
    straight = is_straight(walk)
    parts = []
    for k in range(variants):
        bent = k % 5 >= 2
        if bent and not straight:
            continue
        varied = vary(walk, rng, bent)
        noise_m = float(rng.choice(_NOISES_M))
        yaw_noise_rad = noise_m * _YAW_NOISE_RAD_PER_M * float(rng.choice(_YAW_NOISE_FACTORS))
        seen = as_seen(varied, noise_m, yaw_noise_rad, rng, faults=True)
        if seen:
            weight = _BENT_WEIGHT if bent else 1.0 if straight else _TURNING_WEIGHT
            parts.append(examples_of_walk(varied, seen, weight))
    return _joined(parts, name)


def scoring_examples(path: str, seed: int, bent: bool) -> Examples | None:
    """Examples of a recording as it is, or bent, to measure how far somebody's forecasts err.

    Args:
        path: Name or path of the recording.
        seed: Seed of noise and bends.
        bent: Whether to bend it.

    Returns:
        The examples, without noise and with that of the reference sensor; None for a walk that turns by itself, which
        is not bent.

    Raises:
        GazempcError: If the recording cannot be read, is too short, or nobody walks in it.
    """
    name, walk, rng = _walk_and_chance(path, seed)
    straight = is_straight(walk)
    if bent and not straight:
        return None
    walk = bend(walk, rng) if bent else walk
    weight = _SCORED_BENT_WEIGHT if bent else 1.0 if straight else _SCORED_TURNING_WEIGHT
    parts = []
    for noise_m in _SCORED_NOISES_M:
        seen = as_seen(walk, noise_m, noise_m * _YAW_NOISE_RAD_PER_M, rng, faults=False)
        parts.append(examples_of_walk(walk, seen, weight))
        if bent:
            # How much less is known without orientations is learned here, so that plain recordings stay plain.
            hidden = _HIDDEN[rng.integers(len(_HIDDEN))]
            parts.append(examples_of_walk(walk, [replace(o, **hidden) for o in seen], weight))
    return _joined(parts, name)


def _walk_and_chance(path: str, seed: int) -> tuple[str, GaplessWalk, np.random.Generator]:
    """Name and walk of a recording, and chance that is its own, so that no recording changes another's examples."""
    recording = load(path)
    return recording.name, walk_of(recording), np.random.default_rng([seed, *recording.name.encode()])


def is_straight(walk: GaplessWalk) -> bool:
    """Whether a walk keeps its direction within 20 degrees, as far as strides of it tell."""
    stride = min(30, walk.times_s.size - 1)
    across = walk.head_m[stride:, :2] - walk.head_m[:-stride, :2]
    direction = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
    return bool(np.ptp(direction) < np.radians(20.0))
