"""Do trackers keep identities? Pairs of people who cross, and crowds (MOTA and IDF1, by py-motmetrics).

The recorded tracks of a crowd state no common time: each begins at 0. So people enter one after the other in the order
of the files, at a stated rate. Paths that were walked at other times may pass through each other: a harder task.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from gazempc.errors import MissingOptionalDependencyError, RecordingError
from gazempc.people.people import People, frames_of
from gazempc.recordings.load import load
from gazempc.recordings.recording import Recording, Track, turned
from gazempc.recordings.synthetic.routes import ROUTES
from gazempc.sim.crowd import observe_together
from gazempc.sim.sensor import load_sensor
from gazempc.types import FloatArray, Sighting
from predictors import ConstantVelocity, HeadObservation

# Simple trackers let a person move so far from one frame to the next, and forget them after so long.
_FARTHEST_M, _FORGOTTEN_AFTER_S = 0.7, 1.0


class NearestNeighbour:
    """Gives each detection to the person whose last position is nearest."""

    def __init__(self) -> None:
        self._count = 0
        self._last: dict[int, HeadObservation] = {}

    def numbers(self, observations: Sequence[HeadObservation]) -> list[int]:
        """Take in a frame.

        Args:
            observations: Detections of one instant.

        Returns:
            Each detection's person.
        """
        now_s = observations[0].capture_time_s
        self._last = {n: o for n, o in self._last.items() if now_s - o.capture_time_s <= _FORGOTTEN_AFTER_S}
        known = list(self._last)
        found = [0] * len(observations)
        if known:
            lasts_m = np.array([self._last[number].head_position_base_m for number in known])
            apart_m = cdist(lasts_m, np.array([seen.head_position_base_m for seen in observations]))
            rows, columns = linear_sum_assignment(np.where(apart_m <= _FARTHEST_M, apart_m, 1e6))
            for row, column in zip(rows, columns, strict=True):
                if apart_m[row, column] <= _FARTHEST_M:
                    found[column] = known[row]
        for k, observation in enumerate(observations):
            if not found[k]:
                self._count += 1
                found[k] = self._count
            self._last[found[k]] = observation
        return found


TRACKERS = ("people", "nearest_neighbour")
_SUBJECTS = 14
# Where they cross: so far ahead of the robot. Directions of travel are across the line of sight, give or take.
_RANGE_M = (1.8, 3.0)
_ASIDE_DEG = 45.0
_BEHIND_M = (0.3, 1.5)
# Before and after the crossing, who is who is read off here.
_BEFORE_S, _AFTER_S = (-1.0, -0.5), (0.5, 1.0)
Numbers = Callable[[Sequence[HeadObservation]], list[int]]


class Crossing(NamedTuple):
    """What became of two people who crossed.

    Attributes:
        swapped: Whether a person has the other's identity afterwards.
        renewed: Whether a person has a new identity afterwards.
    """

    swapped: bool
    renewed: bool


def crossing_walks(seed: int) -> tuple[Recording, Recording]:
    """Two synthetic walkers who pass each other behind the robot's line of sight.

    Args:
        seed: Who walks, where, and how far one is behind the other.

    Returns:
        The walks in the base frame; they are in one line of sight at time 0.
    """
    rng = np.random.default_rng([seed, 22])
    straight = [name for name, route in ROUTES.items() if route.group == "straight"]
    who = rng.choice(_SUBJECTS, 2, replace=False) + 1
    range_m, behind_m = rng.uniform(*_RANGE_M), rng.uniform(*_BEHIND_M)
    walks = []
    for side, subject, x_m in zip((1.0, -1.0), who, (range_m, range_m + behind_m), strict=True):
        walk = load(f"subject{subject:02}_{rng.choice(straight)}")
        heading = side * np.pi / 2.0 + np.radians(rng.uniform(-_ASIDE_DEG, _ASIDE_DEG))
        walks.append(_passing(walk, np.array([x_m, 0.0]), heading))
    return walks[0], walks[1]


def _passing(walk: Recording, at_m: FloatArray, heading_rad: float) -> Recording:
    """The walk, turned and moved so that its middle is there, in this direction, at time 0."""
    truth = walk.truth
    middle = walk.times_s.size // 2
    ahead_m = truth.head_position_m[middle + 5] - truth.head_position_m[middle - 5]
    yaw = heading_rad - np.arctan2(ahead_m[1], ahead_m[0])
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    shift_m = np.append(at_m - (turn @ truth.head_position_m[middle])[:2], 0.0)
    moved = Track(
        head_position_m=truth.head_position_m @ turn.T + shift_m,
        head_quat_wxyz=turned(truth.head_quat_wxyz, yaw),
        pelvis_position_m=truth.pelvis_position_m @ turn.T + shift_m,
        pelvis_quat_wxyz=turned(truth.pelvis_quat_wxyz, yaw),
        valid=truth.valid,
    )
    return replace(walk, times_s=walk.times_s - walk.times_s[middle], truth=moved, measured=None)


def cross(seed: int, sensor: str, tracker: str) -> Crossing:
    """Let two people cross, and see whether a tracker keeps them apart.

    Args:
        seed: Of the walks and of the sensor's errors.
        sensor: Name of the sensor, which gives no identities.
        tracker: One of `TRACKERS`.

    Returns:
        What became of them.
    """
    walks = crossing_walks(seed)
    numbers = tracker_of(tracker)
    seen = observe_together(walks, load_sensor(sensor), seed)
    whose = {id(sighting.observation): k for k, sighting in seen}
    before, after = ([Counter[int](), Counter[int]()] for _ in range(2))
    for frame in frames_of([sighting for _, sighting in seen]):
        observations = [sighting.observation for sighting in frame]
        for number, observation in zip(numbers(observations), observations, strict=True):
            time_s, k = observation.capture_time_s, whose[id(observation)]
            for counts, (from_s, to_s) in ((before, _BEFORE_S), (after, _AFTER_S)):
                if number and from_s <= time_s <= to_s:
                    counts[k][number] += 1
    first, last = ([count.most_common(1)[0][0] if count else 0 for count in each] for each in (before, after))
    return Crossing(
        swapped=0 not in first and (last[0] == first[1] or last[1] == first[0]),
        renewed=any(now not in (*first, 0) for now in last),
    )


def tracker_of(name: str) -> Numbers:
    """Make a tracker.

    Args:
        name: One of `TRACKERS`.

    Returns:
        Takes detections of one instant, and gives the person of each; 0 for none.
    """
    if name == "nearest_neighbour":
        return NearestNeighbour().numbers
    people = People(ConstantVelocity)
    return lambda observations: [number for number, _ in people.see(observations)]


# Between a truth and a detection of it.
_MATCH_M = 0.5
# The robot stands beside the corridor.
_BESIDE_M = 6.0
_SENSOR_HEIGHT_M = 1.2


class CrowdScore(NamedTuple):
    """How well the identities of a crowd were kept.

    Attributes:
        crowd: Which tracks.
        tracker: Who assigned the detections.
        people: How many people there were.
        at_once: How many at once, at most.
        mota: Multiple object tracking accuracy, 1 is best (Bernardin & Stiefelhagen 2008).
        idf1: Share of detections with the right identity, 1 is best (Ristani et al. 2016).
        switches: How often a person's identity changed.
    """

    crowd: str
    tracker: str
    people: int
    at_once: int
    mota: float
    idf1: float
    switches: int


def crowd_of(folder: Path, prefix: str, people_per_s: float, most: int) -> list[Recording]:
    """Put recorded tracks into one scene.

    Args:
        folder: Folder of the tracks.
        prefix: What the files' names begin with.
        people_per_s: How many enter in a second.
        most: Not more people than this.

    Returns:
        The walks in the base frame of a robot beside them, on one clock.

    Raises:
        RecordingError: If there are none.
    """
    paths = sorted(folder.glob(f"{prefix}*.csv"))[:most]
    if not paths:
        raise RecordingError(str(folder), "", f"no tracks {prefix}*.csv", "a folder of head tracks")
    walks = [load(path) for path in paths]
    period_s = float(np.median(np.diff(walks[0].times_s)))
    middle_m = np.mean([walk.truth.head_position_m.mean(axis=0) for walk in walks], axis=0)
    base_m = np.array([middle_m[0] - _BESIDE_M, middle_m[1], _SENSOR_HEIGHT_M])
    # On whole frames, so that all are seen in the same ones.
    starts_s = [period_s * round(k / (people_per_s * period_s)) for k in range(len(walks))]
    return [_begun(walk, start_s, base_m) for walk, start_s in zip(walks, starts_s, strict=True)]


def _begun(walk: Recording, start_s: float, base_m: FloatArray) -> Recording:
    truth = replace(walk.truth, head_position_m=walk.truth.head_position_m - base_m)
    return replace(walk, times_s=walk.times_s - walk.times_s[0] + start_s, truth=truth)


def score(crowd: str, walks: Sequence[Recording], sensor: str, seed: int) -> list[CrowdScore]:
    """Let each tracker follow a crowd.

    Args:
        crowd: What the crowd is called.
        walks: The people.
        sensor: Name of the sensor.
        seed: Of its errors.

    Returns:
        A score a tracker.

    Raises:
        MissingOptionalDependencyError: If motmetrics is not installed.
    """
    try:
        import motmetrics  # noqa: F401, PLC0415
    except ImportError:
        raise MissingOptionalDependencyError("scores of crowds", "motmetrics", "crowds") from None
    frames: dict[float, list[tuple[int, Sighting]]] = defaultdict(list)
    for k, sighting in observe_together(walks, load_sensor(sensor), seed):
        frames[round(sighting.observation.capture_time_s, 6)].append((k, sighting))
    times_s = np.unique(np.round(np.concatenate([walk.times_s for walk in walks]), 6))
    ends_s = np.array([(walk.times_s[0], walk.times_s[-1]) for walk in walks])
    at_once = int(max(np.sum((ends_s[:, 0] <= t) & (t <= ends_s[:, 1])) for t in times_s))
    return [
        CrowdScore(crowd, tracker, len(walks), at_once, *_scored(walks, frames, times_s, tracker_of(tracker)))
        for tracker in TRACKERS
    ]


def _scored(
    walks: Sequence[Recording], frames: dict[float, list[tuple[int, Sighting]]], times_s: FloatArray, numbers: Numbers
) -> tuple[float, float, int]:
    import motmetrics  # noqa: PLC0415

    true_m: dict[float, dict[int, FloatArray]] = defaultdict(dict)
    for k, walk in enumerate(walks):
        for time_s, head_m in zip(np.round(walk.times_s, 6).tolist(), walk.truth.head_position_m, strict=True):
            true_m[time_s][k] = head_m
    scored = motmetrics.MOTAccumulator(auto_id=True)
    for time_s in times_s.tolist():
        observations = [sighting.observation for _, sighting in frames.get(time_s, [])]
        found = numbers(observations) if observations else []
        named = [(n, o.head_position_base_m) for n, o in zip(found, observations, strict=True) if n]
        there = list(true_m[time_s].values())
        apart_m = motmetrics.distances.norm2squared_matrix(
            np.array(there), np.array([where for _, where in named]).reshape(-1, 3), max_d2=_MATCH_M**2
        )
        scored.update(list(true_m[time_s]), [n for n, _ in named], apart_m)
    summary = motmetrics.metrics.create().compute(scored, metrics=["mota", "idf1", "num_switches"], name="crowd")
    mota, idf1, switches = summary.loc["crowd"]
    return float(mota), float(idf1), int(switches)
