"""Questions and answers to fit the predictor `walker` on: what it reads at a frame, and how the walk went on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from experiments.fit.pace import KINDS, at_pace, flatten, prolong, sway, vary_standing
from experiments.fit.trackers import beside, draw_tracker, seen_through, wobble
from experiments.fit.variants import GaplessWalk, vary, walk_of
from gazempc.errors import GazempcError
from gazempc.recordings.load import load
from gazempc.sim.sensing.tables import YawError
from gazempc.sim.sensor import SensorSpec, load_sensor
from predictors import HeadObservation
from predictors.walker.features import N_INPUTS
from predictors.walker.network import KNOTS_S, N_DOUBT, N_OUTPUTS, Ensemble, WalkerModel
from predictors.walker.predictor import Walker

# Of three variants two are of the walk as it was recorded, one at another pace and gait: with fewer of the first,
# forecasts of recorded walks lose a tenth; with fewer of the others, those of other people do.
_PLAIN = (True, True, False)
_PACES = dict(zip(KINDS, (0.15, 0.28, 0.27, 0.15, 0.15), strict=True))
_LONG_S = 8.0
# Gait of others differs in size, and many trackers do not see the height.
_SWAY_SHARE, _SWAY_FACTOR, _FLAT_SHARE = 0.5, (0.6, 2.0), 0.5
_BENT_SHARE = 0.6
_WOBBLE_SHARE = 0.5
# Bent walks outnumber the others: with less weight, turns of people left out are forecast worse, and straight walks no
# better. Turns that were recorded are of few people; with more weight, straight walks of others get worse.
_BENT_WEIGHT, _TURNING_WEIGHT = 2.0, 0.5
# Errors of people who stand are small, in millimetres, but a robot sees them all day.
_RECORDED_STANDING_WEIGHT = 1.0
# A fast tracker's frames say the same several times.
_USUAL_HZ = 30.0
_FEWEST_FRAMES = 20
_SCORED_VARIANTS, _SCORED_TURNING_WEIGHT = 12, 2.0
# Only its inputs are used here, so that a model can be fitted where there is none yet.
_NOTHING = Ensemble(*((np.zeros((1, rows, N_OUTPUTS), dtype=np.float32),) for rows in (N_INPUTS, 1)))
_BLANK = WalkerModel(_NOTHING, _NOTHING, _NOTHING, np.zeros((N_DOUBT, KNOTS_S.size, 3)))


@dataclass(frozen=True)
class Examples:
    """Examples of one recording or many, in rows.

    Attributes:
        network: Inputs of the network, shape (N, N_INPUTS). In half precision, as they take most of the memory.
        spread: Inputs of the stated uncertainty, shape (N, N_SPREAD).
        noise_m: Stated standard deviation of the observed position, shape (N, 3), metres; zeros where none is stated.
        departure_m: How the walk left its line, shape (N, knots, 3), along, across, up; NaN after its end.
        weight: How much each counts, shape (N,).
        line_m_s: Velocity of the line, shape (N, 3).
        places_m: Places to stay at, shape (N, N_PLACES, 3).
        precise: Weight of the networks for precise trackers, shape (N,).
    """

    network: NDArray[np.float16]
    spread: NDArray[np.float32]
    noise_m: NDArray[np.float32]
    departure_m: NDArray[np.float32]
    weight: NDArray[np.float32]
    line_m_s: NDArray[np.float32]
    places_m: NDArray[np.float32]
    precise: NDArray[np.float32]


T = TypeVar("T")


def join(parts: Sequence[T]) -> T:
    """Arrays of many recordings in one table."""
    names = [field.name for field in fields(parts[0])]  # type: ignore[arg-type]
    return type(parts[0])(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _joined(parts: list[Examples], name: str) -> Examples:
    known = [p for p in parts if p.weight.size]
    if not known:
        raise GazempcError(f"{name}: no person slower than 3 m/s is observed, so there are no examples: leave it out")
    return join(known)


def examples_of_walk(walk: GaplessWalk, observations: list[HeadObservation], weight: float) -> Examples:
    """What `Walker` reads at each frame of a walk, and how the walk went on.

    Args:
        walk: The true walk.
        observations: What is seen of it.
        weight: Weight of each example; frames of a running person count less.

    Returns:
        The examples.
    """
    truth = CubicSpline(walk.times_s, walk.head_m)
    walker = Walker(_BLANK)
    found: list[tuple[Any, ...]] = []
    for observation in observations:
        walker.update(observation)
        inputs = walker.inputs()
        line = inputs.line
        if line.time_s != observation.capture_time_s or inputs.on_foot == 0.0:
            continue
        ahead_s = line.time_s + KNOTS_S
        off = truth(ahead_s) - line.origin_base_m - KNOTS_S[:, None] * line.velocity_base_m_s
        off = off @ line.to_base()
        off[ahead_s > walk.times_s[-1] + 1e-6] = np.nan
        truth_and_weight = off, weight * inputs.on_foot
        regimes = inputs.line_m_s, inputs.places_m, inputs.precise
        found.append((inputs.network, inputs.spread, inputs.stated_sd_m, *truth_and_weight, *regimes))
    network, *others = zip(*found, strict=True) if found else ((),) * len(fields(Examples))
    return Examples(np.array(network, dtype=np.float16), *(np.array(each, dtype=np.float32) for each in others))


def fitting_examples(
    path: str, seed: int, variants: int, tracker: SensorSpec | None = None, precise: bool = False
) -> Examples:
    """Examples of a recording and its variants, each seen through a tracker.

    Args:
        path: Name or path of the recording.
        seed: Seed of all that is random, with the recording's name.
        variants: How many variants to make.
        tracker: The tracker; without it, each variant has one drawn at random.
        precise: Whether those are trackers with little error.

    Returns:
        The examples.

    Raises:
        GazempcError: If the recording cannot be read, is too short, or no person walks in it.
    """
    name, walk, rng, stands = _walk_and_chance(path, seed)
    plain = [_PLAIN[k % len(_PLAIN)] for k in range(variants)]
    return _joined(_variants(walk, rng, plain, tracker, stands, precise), name)


def _variants(
    walk: GaplessWalk,
    rng: np.random.Generator,
    plain: Sequence[bool],
    given: SensorSpec | None,
    stands: bool,
    precise: bool = False,
) -> list[Examples]:
    straight = is_straight(walk)
    parts = []
    for each in plain:
        if stands:
            varied, bent = vary_standing(walk, rng), False
        else:
            varied, bent = _variant(walk, straight, each, rng)
        if varied.times_s.size < _FEWEST_FRAMES:
            continue
        kind = "precise" if precise else "plain" if each else "other"
        tracker, sensor = ("given", given) if given else draw_tracker(rng, kind)
        if tracker == "street":
            varied = flatten(varied)
            if rng.random() < _WOBBLE_SHARE:
                varied = wobble(varied, rng)
        varied = beside(varied, rng)
        weight = _BENT_WEIGHT if bent else 1.0 if straight else _TURNING_WEIGHT
        weight = _RECORDED_STANDING_WEIGHT if stands else weight
        weight *= min(1.0, _USUAL_HZ / sensor.rate_hz)
        parts.append(examples_of_walk(varied, seen_through(varied, tracker, sensor, rng), weight))
    return parts


def _variant(walk: GaplessWalk, straight: bool, plain: bool, rng: np.random.Generator) -> tuple[GaplessWalk, bool]:
    """A variant, and whether it is bent."""
    kind = "own" if plain else str(rng.choice(list(_PACES), p=list(_PACES.values())))
    bent = bool(straight and kind != "stand" and rng.random() < _BENT_SHARE)
    if kind != "own":
        walk = at_pace(prolong(walk, _LONG_S) if straight else walk, kind, rng)
    if not plain:
        if rng.random() < _SWAY_SHARE:
            walk = sway(walk, rng.uniform(*_SWAY_FACTOR))
        if rng.random() < _FLAT_SHARE:
            walk = flatten(walk)
    if walk.times_s.size < _FEWEST_FRAMES:
        return walk, bent
    return vary(walk, rng, bent, kind == "own"), bent


def scoring_sensors() -> tuple[SensorSpec, ...]:
    """Trackers through which people left out are seen, to measure how far forecasts of them err."""
    reference, camera = load_sensor("reference"), load_sensor("face_camera")
    hidden = YawError(reported=False)
    blind = reference.model_copy(update={"name": "positions", "head_yaw": hidden, "pelvis_yaw": hidden})
    silent = camera.model_copy(update={"name": "silent_camera", "states_covariance": False})
    perfect, body, street = (load_sensor(name) for name in ("perfect", "body_tracker", "street"))
    return perfect, reference, blind, body, camera, street, silent


def scoring_examples(path: str, seed: int, tracker: SensorSpec | None = None) -> Examples:
    """Examples of a recording as it is, through each of `scoring_sensors`, and of other walks made of it.

    Args:
        path: Name or path of the recording.
        seed: Seed of the trackers' errors.
        tracker: The only tracker; without it, there are `scoring_sensors`, and trackers drawn at random.

    Returns:
        The examples.

    Raises:
        GazempcError: If the recording cannot be read, is too short, or no person walks in it.
    """
    name, walk, rng, stands = _walk_and_chance(path, seed)
    # Errors in real turns are larger than in bent walks, and real turns are rare in recordings.
    weight = 1.0 if is_straight(walk) else _SCORED_TURNING_WEIGHT
    parts = []
    for sensor in (tracker,) if tracker else scoring_sensors():
        placed = beside(walk, rng)
        parts.append(examples_of_walk(placed, seen_through(placed, "given", sensor, rng), weight))
    parts += _variants(walk, rng, [False] * _SCORED_VARIANTS, tracker, stands)
    return _joined(parts, name)


def _walk_and_chance(path: str, seed: int) -> tuple[str, GaplessWalk, np.random.Generator, bool]:
    """Name and walk of a recording, and chance that is its own, so that no recording changes another's examples."""
    recording = load(path)
    chance = np.random.default_rng([seed, *recording.name.encode()])
    return recording.name, walk_of(recording), chance, recording.labels.activity == "standing"


def is_straight(walk: GaplessWalk) -> bool:
    """Whether a walk keeps its direction within 20 degrees, as far as strides of it tell."""
    stride = min(30, walk.times_s.size - 1)
    across = walk.head_m[stride:, :2] - walk.head_m[:-stride, :2]
    direction = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
    return bool(np.ptp(direction) < np.radians(20.0))
