"""Scale of a BVH file: which axis is up, and how long its unit is; both told by the person."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gazempc.errors import RecordingError
from gazempc.recordings.readers.bvh_motion import poses
from gazempc.recordings.readers.bvh_parse import Bvh
from gazempc.recordings.readers.bvh_tree import rest_positions, stands
from gazempc.recordings.readers.position_checks import HEAD_TO_PELVIS_RANGE_M, median_head_to_pelvis_m
from gazempc.recordings.recording import Track
from gazempc.types import FloatArray

_UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "CMU's ASF unit": 0.0254 / 0.45}
_STANDING_HEIGHT_RANGE_M = (1.3, 2.1)
_HEIGHT_SAMPLES = 12
_MIN_UP_COSINE = 0.85  # people lean less than 30 degrees when they walk


@dataclass(frozen=True)
class Scale:
    """Metres per unit of a file, and words for people."""

    unit_m: float
    said: str


def up_axis(path: Path, wanted: str | None, head_position: FloatArray, hips_position: FloatArray) -> FloatArray:
    """Unit vector of the file's axis that points up, shape (3,).

    It is where the head is from the hips in the motion, not in the rest pose. Some files keep their skeleton along
    another axis and turn it upright in every frame.
    """
    axis = np.zeros(3)
    if wanted is not None:
        axis["xyz".index(wanted)] = 1.0
        return axis
    to_head = np.mean(head_position - hips_position, axis=0)
    length = float(np.linalg.norm(to_head))
    largest = int(np.argmax(np.abs(to_head)))
    if abs(to_head[largest]) < _MIN_UP_COSINE * length or length == 0.0:
        raise RecordingError(
            path,
            "MOTION",
            f"no axis points up: from hips to head is ({', '.join(f'{x:.3g}' for x in to_head)}) in the mean",
            "an upright person, or the option bvh_up_axis (y or z)",
        )
    axis[largest] = np.sign(to_head[largest])
    return axis


def scale_of(path: Path, bvh: Bvh, hips: int, up: FloatArray, rest_up: FloatArray, wanted_m: float | None) -> Scale:
    """Metres per file unit, from the person's height in the motion or, if that fits none, the rest pose.

    Args:
        path: File, for messages.
        bvh: The file.
        hips: Index of the hips.
        up: The file's axis that points up in the motion, shape (3,).
        rest_up: The same in the rest pose.
        wanted_m: What the user says; None: inferred.

    Returns:
        The scale.

    Raises:
        RecordingError: If no unit makes the person as high as people are, or motion and rest pose disagree.
    """
    heights = _heights(bvh, up, rest_up)
    said = f"{heights[0]:.4g} units high ({heights[1]:.4g} in the rest pose)"
    if wanted_m is not None:
        return Scale(wanted_m, f"unit {wanted_m:.6g} m as said ({heights[0] * wanted_m:.2f} m high)")
    low_m, high_m = _STANDING_HEIGHT_RANGE_M
    fitting = [
        next((name for name, unit_m in _UNITS_M.items() if low_m <= height * unit_m <= high_m), None)
        for height in heights
    ]
    candidates = ", ".join(f"{name} ({unit_m:.6g})" for name, unit_m in _UNITS_M.items())
    # A rest pose that does not stand has no height.
    if None not in fitting and fitting[0] != fitting[1] and stands(bvh.joints, hips, rest_up):
        problem = f"the person is {said}: {fitting[0]} by the motion, {fitting[1]} by the rest pose"
        raise RecordingError(path, "HIERARCHY", problem, f"the option bvh_unit_m, one of {candidates}")
    name = fitting[0] or fitting[1]
    if name is None:
        raise RecordingError(
            path,
            "HIERARCHY",
            f"the person is {said}, in no known unit {low_m:g} to {high_m:g} m",
            f"one of the units {candidates}, or the option bvh_unit_m",
        )
    height = heights[0] if fitting[0] else heights[1]
    return Scale(_UNITS_M[name], f"unit {name} ({height * _UNITS_M[name]:.2f} m high)")


def _heights(bvh: Bvh, up: FloatArray, rest_up: FloatArray) -> tuple[float, float]:
    """Height of the person in the motion (median) and in the rest pose, file units."""
    rest = rest_positions(bvh.joints)
    ends = {index: joint.end_offset for index, joint in enumerate(bvh.joints) if joint.end_offset is not None}
    sampled = poses(bvh, range(len(bvh.joints)), slice(None, None, max(1, len(bvh.motion) // _HEIGHT_SAMPLES)))
    in_motion = [position for _, position in sampled.values()]
    in_motion += [sampled[index][1] + sampled[index][0].apply(offset) for index, offset in ends.items()]
    in_rest = np.vstack([rest, *(rest[index] + offset for index, offset in ends.items())])
    return float(np.median(np.ptp(np.array(in_motion) @ up, axis=0))), float(np.ptp(in_rest @ rest_up))


def check_size(path: Path, truth: Track, unit_m: float) -> None:
    """Refuse a skeleton that is no person's, or a wrong unit that the user gave."""
    distance_m = median_head_to_pelvis_m(truth.head_position_m, truth.pelvis_position_m)
    low_m, high_m = HEAD_TO_PELVIS_RANGE_M
    if not low_m <= distance_m <= high_m:
        raise RecordingError(
            path,
            "positions",
            f"the head is {distance_m:.4g} m from the hips (median) with {unit_m:.6g} m a unit",
            f"{low_m:g} to {high_m:g} m; the options bvh_unit_m, bvh_head_joint and bvh_hips_joint change it",
        )
