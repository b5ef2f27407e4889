"""Recordings from motion capture as BVH, of any skeleton with a head and two sides.

The only maintained library (bvhio 1.5.4) does not terminate on truncated files and reads single precision.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.recordings.readers.bvh_parse import Bvh, Pose, parse_bvh, poses
from gazempc.recordings.readers.bvh_skeleton import (
    axis_name,
    find_skeleton,
    head_tip,
    person_axes,
    rest_positions,
    stands_at_rest,
)
from gazempc.recordings.readers.checks import recording_of
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.recording import Recording, Track
from gazempc.types import FloatArray

_REST_FRAME_JUMP_DEG = 30.0
_MIN_UP_COSINE = 0.85  # people lean less than 30 degrees when they walk
_UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "CMU's ASF unit": 0.0254 / 0.45}
_STANDING_HEIGHT_RANGE_M = (1.3, 2.1)
_HEIGHT_SAMPLES = 12
_OPTIONS = "bvh_unit_m, bvh_up_axis, bvh_head_joint, bvh_hips_joint, bvh_facing, bvh_frame_rate_hz"


def read_bvh(path: Path, options: ReadOptions) -> Recording:
    """Read a BVH file.

    The head is the tip of the head's bone where the file has one. Orientations of head and hips equal the person's
    facing in the rest pose. A first frame in the rest pose (common in conversions of the CMU database) is left out.

    Args:
        path: File to read.
        options: Unit, frame rate, head and hips joints, facing and up axis, to override inferred values.

    Returns:
        The recording; time starts at 0. One line of its notes lists the inferred values.

    Raises:
        RecordingError: If the file is damaged, or head, facing, unit or up axis is ambiguous; names the option that
            resolves it.
    """
    bvh, left_out = _without_rest_frame(parse_bvh(path))
    joints = bvh.joints
    skeleton = find_skeleton(path, joints, options.bvh_head_joint, options.bvh_hips_joint)
    head, hips = skeleton.head, skeleton.hips
    tip, tip_offset = head_tip(joints, head)
    pose_of = poses(bvh, {head, hips, tip})
    head_position, hips_position = pose_of[tip][1] + pose_of[tip][0].apply(tip_offset), pose_of[hips][1]
    travel = _travel_direction(pose_of[hips], np.linalg.norm(head_position - hips_position, axis=1))
    person, facing_by = person_axes(path, joints, skeleton, options.bvh_facing, travel)
    up = _up_axis(path, options.bvh_up_axis, np.mean(head_position - hips_position, axis=0))
    unit_m, unit = _unit(path, bvh, hips, (up, person[:, 2]), options.bvh_unit_m)
    # With y up, z becomes x.
    forward = np.roll(np.abs(up), 1)
    out = Rotation.from_matrix(np.vstack([forward, np.cross(up, forward), up]))

    turns = [out * pose_of[joint][0] * Rotation.from_matrix(person) for joint in (head, hips)]
    head_quat, hips_quat = (turn.as_quat(scalar_first=True) for turn in turns)
    frame_s = bvh.frame_time_s if options.bvh_frame_rate_hz is None else 1.0 / options.bvh_frame_rate_hz
    point = "tip of its bone" if tip != head or tip_offset.any() else "the joint"
    point += f", {skeleton.head_by}" if skeleton.head_by else ""
    inferred = (
        f"read as: {unit}, {axis_name(up)} up, head {joints[head].name} ({point}), "
        f"hips {joints[hips].name}, facing {axis_name(person[:, 0])} at rest ({facing_by}), "
        f"{1.0 / frame_s:.4g} frames per second"
    )
    track = Track(
        head_position_m=unit_m * out.apply(head_position),
        head_quat_wxyz=head_quat,
        pelvis_position_m=unit_m * out.apply(hips_position),
        pelvis_quat_wxyz=hips_quat,
    )
    times_s, note = frame_s * np.arange(len(bvh.motion), dtype=np.float64), f"; the options {_OPTIONS} change it"
    notes = [f"{inferred}{note}", *left_out]
    return recording_of(path, times_s, track, "motion capture", has_robot=False, note=note, notes=notes)


def _without_rest_frame(bvh: Bvh) -> tuple[Bvh, list[str]]:
    """Drop a first frame in the rest pose (rotations of exactly 0, then a jump), with a note."""
    is_rotation = np.array([channel.endswith("rotation") for joint in bvh.joints for channel in joint.channels])
    turns_deg = bvh.motion[:2][:, is_rotation]
    in_rest = len(turns_deg) == 2 and is_rotation.any() and not turns_deg[0].any()
    if in_rest and np.abs((turns_deg[1] + 180.0) % 360.0 - 180.0).max() > _REST_FRAME_JUMP_DEG:
        return replace(bvh, motion=bvh.motion[1:]), ["first frame (rest pose) left out"]
    return bvh, []


def _up_axis(path: Path, wanted: str | None, to_head: FloatArray) -> FloatArray:
    """Unit vector of the file's axis that points up, shape (3,): from hips to head in the motion.

    Some files define the skeleton along another axis and rotate it upright in every frame.
    """
    if wanted is not None:
        return np.asarray(np.eye(3)["xyz".index(wanted)])
    largest = int(np.argmax(np.abs(to_head)))
    if abs(to_head[largest]) <= _MIN_UP_COSINE * np.linalg.norm(to_head):
        shown = ", ".join(f"{x:.3g}" for x in to_head)
        problem = f"no axis points up: the mean vector from hips to head is ({shown})"
        raise RecordingError(path, "MOTION", problem, "an upright person, or the option bvh_up_axis (y or z)")
    return np.asarray(np.sign(to_head[largest]) * np.eye(3)[largest])


def _travel_direction(hips: Pose, from_head: FloatArray) -> FloatArray | None:
    """Direction of travel in the axes of the rest pose, shape (3,); None for a person who stays in one place.

    Args:
        hips: N rotations and positions of the hips.
        from_head: Distance from head to hips, shape (N,), file units; a walk is longer.
    """
    way = hips[0][:-1].inv().apply(np.diff(hips[1], axis=0)).sum(axis=0)
    return way if np.linalg.norm(way) > np.median(from_head) else None


def _unit(
    path: Path, bvh: Bvh, hips: int, ups: tuple[FloatArray, FloatArray], wanted_m: float | None
) -> tuple[float, str]:
    """Metres per file unit from the person's height in the motion, else in the rest pose; and its origin in words.

    Args:
        path: File, for messages.
        bvh: The file.
        hips: Index of the hips.
        ups: Unit vectors in the file's axes that point up in the motion and in the rest pose, shape (3,).
        wanted_m: The user's unit; None: inferred.

    Raises:
        RecordingError: If no unit gives a plausible height, or motion and rest pose disagree.
    """
    height, height_at_rest = _heights(bvh, *ups)
    if wanted_m is not None:
        return wanted_m, f"unit {wanted_m:.6g} m by bvh_unit_m ({height * wanted_m:.2f} m high)"
    low_m, high_m = _STANDING_HEIGHT_RANGE_M
    name, name_at_rest = (
        next((unit for unit, unit_m in _UNITS_M.items() if low_m <= units * unit_m <= high_m), None)
        for units in (height, height_at_rest)
    )
    candidates = ", ".join(f"{unit} ({unit_m:.6g})" for unit, unit_m in _UNITS_M.items())
    problem = f"the person is {height:.4g} units high ({height_at_rest:.4g} in the rest pose)"
    # The rest pose gives a height only if it stands.
    if name != name_at_rest and name and name_at_rest and stands_at_rest(bvh.joints, hips, ups[1]):
        problem += f": {name} by the motion, {name_at_rest} by the rest pose"
        raise RecordingError(path, "MOTION", problem, f"the option bvh_unit_m, one of {candidates}")
    if name is not None:
        return _UNITS_M[name], f"unit {name} ({height * _UNITS_M[name]:.2f} m high)"
    if name_at_rest is not None:
        unit_m = _UNITS_M[name_at_rest]
        return unit_m, f"unit {name_at_rest} ({height_at_rest * unit_m:.2f} m high in the rest pose)"
    problem += f", which is {low_m:g} to {high_m:g} m in no known unit"
    raise RecordingError(path, "MOTION", problem, f"one of the units {candidates}, or the option bvh_unit_m")


def _heights(bvh: Bvh, up: FloatArray, up_at_rest: FloatArray) -> tuple[float, float]:
    """Height of the person in the motion (median) and in the rest pose, file units."""
    rest = rest_positions(bvh.joints)
    ends = {index: joint.end_offset for index, joint in enumerate(bvh.joints) if joint.end_offset is not None}
    thinned = slice(None, None, max(1, len(bvh.motion) // _HEIGHT_SAMPLES))
    sampled = poses(bvh, range(len(bvh.joints)), thinned)
    points = [position for _, position in sampled.values()]
    points += [sampled[index][1] + sampled[index][0].apply(offset) for index, offset in ends.items()]
    at_rest = np.vstack([rest, *(rest[index] + offset for index, offset in ends.items())])
    return float(np.median(np.ptp(np.array(points) @ up, axis=0))), float(np.ptp(at_rest @ up_at_rest))
