"""Training and test examples of the predictor `walker`: its inputs at a frame, and the true path after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from experiments.fit.pace import at_pace, flatten, prolong, sway, vary_standing
from experiments.fit.trackers import USUAL_HZ, beside, draw_tracker, seen_through, with_onset_error, wobble
from experiments.fit.variants import GaplessWalk, vary, walk_of
from gazempc.errors import GazempcError, SettingsError
from gazempc.recordings.load import load
from gazempc.sim.sensing.spec import YawError
from gazempc.sim.sensor import SensorSpec, load_sensor
from predictors import HeadObservation
from predictors.walker.features import N_INPUTS
from predictors.walker.knots import KNOTS_S
from predictors.walker.network import N_DOUBT, N_OUTPUTS, Network, WalkerModel
from predictors.walker.predictor import Walker

# Two of three variants keep recorded pace and gait. With fewer of these, errors on recorded walks grow by a tenth; with
# more, errors on other people do.
_PLAIN = (True, True, False)
# Probability of each pace of the other variants: recorded, or a kind of `at_pace`.
_PACES = {"own": 0.15, "steady": 0.28, "start": 0.27, "stop": 0.15, "stand": 0.15}
_LONG_S = 8.0
# Shares of the examples with scaled gait, and at constant height: many trackers are planar.
_SWAY_SHARE, _SWAY_FACTOR, _FLAT_SHARE = 0.5, (0.6, 2.0), 0.5
_BENT_SHARE = 0.6
_WOBBLE_SHARE = 0.5
# Additional variants with an error of the first frames, as a share of the others, of walking and of standing people: in
# three tracks of waiting pedestrians that begin with a jump, none in the fit, the gaze error falls by a third. Three
# times as many: forecast at 0.5 s 0.6 % worse on walking people left out.
_ONSET_SHARE, _ONSET_SHARE_STANDING = 0.2, 0.4
# Weights of synthetic and of recorded turns. A lower weight of the first increases errors in turns of people left out,
# without a benefit on straight walks; a higher weight of the second, of few people, increases errors on straight walks.
_SYNTHETIC_TURN_WEIGHT, _RECORDED_TURN_WEIGHT = 2.0, 0.5
_FEWEST_FRAMES = 20
_SCORED_VARIANTS, _SCORED_TURNING_WEIGHT = 12, 2.0
# Placeholder network: only the inputs of `Walker` are used here, so a fit needs no earlier model.
_ZEROS = Network(*((np.zeros(shape, dtype=np.float32),) for shape in ((N_INPUTS, N_OUTPUTS), N_OUTPUTS)))
_BLANK = WalkerModel(_ZEROS, _ZEROS, np.zeros((N_DOUBT, KNOTS_S.size, 3)))


@dataclass(frozen=True)
class Examples:
    """Examples of one or several recordings, one per row.

    Attributes:
        network: Inputs of the networks, shape (N, N_INPUTS); half precision, to save memory.
        spread: Inputs of the uncertainty model, shape (N, N_SPREAD).
        noise_m: Stated standard deviation of the observed position, shape (N, 3), metres; zeros if none is stated.
        departure_m: True departure from the line, shape (N, knots, 3), metres along, across, up; NaN past the end.
        weight: Weight of each example, shape (N,).
        places_m: Candidate places of staying, shape (N, N_PLACES, 3), metres.
        velocities_m_s: Velocities of the line and of the filters along, across and up, shape (N, N_VELOCITIES, 3), m/s.
    """

    network: NDArray[np.float16]
    spread: NDArray[np.float32]
    noise_m: NDArray[np.float32]
    departure_m: NDArray[np.float32]
    weight: NDArray[np.float32]
    places_m: NDArray[np.float32]
    velocities_m_s: NDArray[np.float32]


T = TypeVar("T")


def join(parts: Sequence[T]) -> T:
    """Concatenate the arrays of several recordings."""
    names = [field.name for field in fields(parts[0])]  # type: ignore[arg-type]
    return type(parts[0])(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _joined(parts: list[Examples], name: str) -> Examples:
    known = [p for p in parts if p.weight.size]
    if not known:
        raise GazempcError(
            f"{name}: no examples: the person is motionless or faster than 3 m/s in every frame; leave it out"
        )
    return join(known)


def examples_of_walk(walk: GaplessWalk, observations: list[HeadObservation], weight: float) -> Examples:
    """Inputs of `Walker` at each frame of a walk, and the true departure from the line.

    Args:
        walk: The true walk.
        observations: Observations of the walk, in order of capture.
        weight: Weight of an example; reduced at running speeds.

    Returns:
        The examples.
    """
    truth = CubicSpline(walk.times_s, walk.head_m)
    walker = Walker(_BLANK)
    found: list[tuple[Any, ...]] = []
    for observation in observations:
        walker.update(observation)
        inputs = walker.inputs()
        if inputs.time_s != observation.capture_time_s or inputs.on_foot == 0.0:
            continue
        ahead_s = inputs.time_s + KNOTS_S
        off = truth(ahead_s) - inputs.origin_base_m - KNOTS_S[:, None] * inputs.velocity_base_m_s
        off = off @ inputs.to_base
        off[ahead_s > walk.times_s[-1] + 1e-6] = np.nan
        truth_and_weight = off, weight * inputs.on_foot
        regimes = inputs.places_m, inputs.velocities_m_s
        stated_m2 = np.diag(inputs.to_base.T @ inputs.stated_m2 @ inputs.to_base)
        found.append((inputs.network, inputs.spread, np.sqrt(np.maximum(stated_m2, 0.0)), *truth_and_weight, *regimes))
    network, *others = zip(*found, strict=True) if found else ((),) * len(fields(Examples))
    return Examples(np.array(network, dtype=np.float16), *(np.array(each, dtype=np.float32) for each in others))


def fitting_examples(path: str, seed: int, variants: int, tracker: SensorSpec | None = None) -> Examples:
    """Examples of random variants of a recording, each observed by a tracker.

    Args:
        path: Name or path of the recording.
        seed: Seed of the random generator, together with the recording's name.
        variants: Number of variants.
        tracker: The tracker; None to draw one at random for each variant.

    Returns:
        The examples.

    Raises:
        GazempcError: If the recording cannot be read, is too short, or gives no examples.
    """
    name, walk, rng, stands = _walk_and_rng(path, seed)
    onsets = round((_ONSET_SHARE_STANDING if stands else _ONSET_SHARE) * variants)
    plain = [_PLAIN[k % len(_PLAIN)] for k in range(variants + onsets)]
    return _joined(_variants(walk, rng, plain, tracker, stands, variants), name)


def _variants(
    walk: GaplessWalk,
    rng: np.random.Generator,
    plain: Sequence[bool],
    given: SensorSpec | None,
    stands: bool,
    n_whole: int,
) -> list[Examples]:
    """Variants of a walk; those after the first `n_whole` have an error of their first frames."""
    straight = is_straight(walk)
    parts, unseen = [], None
    for k, each in enumerate(plain):
        if stands:
            varied, bent = vary_standing(walk, rng), False
        else:
            varied, bent = _variant(walk, straight, each, rng)
        if varied.times_s.size < _FEWEST_FRAMES:
            continue
        tracker, sensor = ("given", given) if given else draw_tracker(rng, each)
        if tracker == "street":
            varied = flatten(varied)
            if rng.random() < _WOBBLE_SHARE:
                varied = wobble(varied, rng)
        varied = beside(varied, rng)
        weight = _SYNTHETIC_TURN_WEIGHT if bent else 1.0 if straight or stands else _RECORDED_TURN_WEIGHT
        weight *= min(1.0, USUAL_HZ / sensor.rate_hz)  # at a higher frame rate successive frames are redundant
        try:
            seen = seen_through(varied, tracker, sensor, rng)
        except SettingsError as error:  # a short variant at a low rate can lose all frames
            unseen = error
            continue
        parts.append(examples_of_walk(varied, seen if k < n_whole else with_onset_error(seen, rng), weight))
    if unseen and not parts:
        raise unseen
    return parts


def _variant(walk: GaplessWalk, straight: bool, plain: bool, rng: np.random.Generator) -> tuple[GaplessWalk, bool]:
    """A random variant, and whether it has synthetic turns."""
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
    """Trackers for the forecast errors on people left out."""
    reference, camera = load_sensor("reference"), load_sensor("face_camera")
    hidden = YawError(reported=False)
    blind = reference.model_copy(update={"name": "positions", "head_yaw": hidden, "pelvis_yaw": hidden})
    silent = camera.model_copy(update={"name": "silent_camera", "states_covariance": False})
    perfect, body, street = (load_sensor(name) for name in ("perfect", "body_tracker", "street"))
    return perfect, reference, blind, body, camera, street, silent


def scoring_examples(path: str, seed: int, tracker: SensorSpec | None = None) -> Examples:
    """Test examples: the unmodified recording with each of `scoring_sensors`, and random variants.

    Args:
        path: Name or path of the recording.
        seed: Seed of the random generator, together with the recording's name.
        tracker: The only tracker; None for `scoring_sensors`, and random trackers of the variants.

    Returns:
        The examples.

    Raises:
        GazempcError: If the recording cannot be read, is too short, or gives no examples.
    """
    name, walk, rng, stands = _walk_and_rng(path, seed)
    # Errors in recorded turns are larger than in synthetic ones, and recorded turns are rare.
    weight = 1.0 if is_straight(walk) else _SCORED_TURNING_WEIGHT
    parts = []
    for sensor in (tracker,) if tracker else scoring_sensors():
        placed = beside(walk, rng)
        parts.append(examples_of_walk(placed, seen_through(placed, "given", sensor, rng), weight))
    parts += _variants(walk, rng, [False] * _SCORED_VARIANTS, tracker, stands, _SCORED_VARIANTS)
    return _joined(parts, name)


def _walk_and_rng(path: str, seed: int) -> tuple[str, GaplessWalk, np.random.Generator, bool]:
    """Name and walk, a random generator independent of other recordings, and whether the person stands."""
    recording = load(path)
    rng = np.random.default_rng([seed, *recording.name.encode()])
    return recording.name, walk_of(recording), rng, recording.labels.activity == "standing"


def is_straight(walk: GaplessWalk) -> bool:
    """Whether the direction, over displacements of a stride, varies by less than 20 degrees."""
    stride = min(30, walk.times_s.size - 1)
    across = walk.head_m[stride:, :2] - walk.head_m[:-stride, :2]
    direction = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
    return bool(np.ptp(direction) < np.radians(20.0))
