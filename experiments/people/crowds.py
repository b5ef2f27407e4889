"""Crowds of recorded people who walk through each other's view: MOTA and IDF1, by py-motmetrics.

The tracks state no common time: each begins at 0. So people enter one after the other in the order of the files, at a
stated rate. Paths that were walked at other times may pass through each other, which makes it harder.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from experiments.people.crossing import TRACKERS, Numbers, tracker_of
from gazempc.errors import MissingOptionalDependencyError, RecordingError
from gazempc.recordings.load import load
from gazempc.recordings.recording import Recording
from gazempc.sim.crowd import observe_together
from gazempc.sim.sensor import load_sensor
from gazempc.types import FloatArray, Sighting

# Between a truth and a detection of it.
_FARTHEST_M = 0.5
# The robot stands beside the corridor.
_BESIDE_M = 6.0
_SENSOR_HEIGHT_M = 1.2


@dataclass(frozen=True)
class CrowdScore:
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
            np.array(there), np.array([where for _, where in named]).reshape(-1, 3), max_d2=_FARTHEST_M**2
        )
        scored.update(list(true_m[time_s]), [n for n, _ in named], apart_m)
    summary = motmetrics.metrics.create().compute(scored, metrics=["mota", "idf1", "num_switches"], name="crowd")
    mota, idf1, switches = summary.loc["crowd"]
    return float(mota), float(idf1), int(switches)
