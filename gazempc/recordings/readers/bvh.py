"""Recordings from motion capture as BVH, of any skeleton that has a head, hips, and a left and a right side.

The parser is our own: the one maintained library (bvhio 1.5.4) never returns on a file that is cut off and
reads numbers in single precision.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.recordings.readers.bvh_parse import Bvh, parse_bvh
from gazempc.recordings.readers.bvh_skeleton import (
    find_head,
    find_hips,
    head_tip,
    person_axes_in_rest,
    poses,
    rest_positions,
)
from gazempc.recordings.readers.checks import (
    check_frame_count,
    check_frame_interval,
)
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.position_checks import (
    HEAD_TO_PELVIS_RANGE_M,
    check_upright,
    median_head_to_pelvis_m,
)
from gazempc.recordings.recording import Recording, Track
from gazempc.types import FloatArray

_UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "CMU's ASF unit": 0.0254 / 0.45}
_STANDING_HEIGHT_RANGE_M = (1.3, 2.1)
_HEIGHT_SAMPLES = 12
_REST_FRAME_JUMP_DEG = 30.0
_MIN_UP_COSINE = 0.85  # people lean less than 30 degrees when they walk


def read_bvh(path: Path, options: ReadOptions) -> Recording:
    """Read a BVH file.

    The head is the tip of the head's bone where the file has one. Orientations are those of the joints'
    bones, so that in the rest pose head and hips face where the person faces. A first frame that only shows
    the rest pose (common in conversions of the CMU database) is left out.

    Args:
        path: File to read.
        options: Unit, frame rate, head and hips joints and up axis, where the file's own must not be used.

    Returns:
        The recording; time starts at 0.

    Raises:
        RecordingError: If the file is damaged, has no head or no sides, or its unit or up axis is in doubt.
    """
    bvh, note = _without_rest_frame(parse_bvh(path))
    count = len(bvh.motion)
    check_frame_count(path, count)
    head = find_head(path, bvh.joints, options.bvh_head_joint)
    hips = find_hips(path, bvh.joints, options.bvh_hips_joint)
    person_axes = person_axes_in_rest(path, bvh.joints, head, hips)
    tip, tip_offset = head_tip(bvh.joints, head)
    pose_of = poses(bvh, {head, hips, tip}, slice(None))
    head_position = pose_of[tip][1] + pose_of[tip][0].apply(tip_offset)
    hips_position = pose_of[hips][1]
    up = _up_axis(path, options.bvh_up_axis, head_position, hips_position)
    unit_m = options.bvh_unit_m or _unit_m(path, bvh, up, person_axes[:, 2])
    out_from_file = _out_from_file(up)
    truth = Track(
        head_position_m=np.asarray(head_position @ out_from_file.T * unit_m),
        head_quat_wxyz=_quat_wxyz(out_from_file, pose_of[head][0], person_axes),
        pelvis_position_m=np.asarray(hips_position @ out_from_file.T * unit_m),
        pelvis_quat_wxyz=_quat_wxyz(out_from_file, pose_of[hips][0], person_axes),
        valid=np.ones(count, dtype=np.bool_),
    )
    rate_hz = options.bvh_frame_rate_hz
    times_s = np.arange(count, dtype=np.float64) * (bvh.frame_time_s if rate_hz is None else 1.0 / rate_hz)
    check_frame_interval(path, times_s)
    _check_size(path, truth, unit_m)
    check_upright(path, truth.head_position_m, truth.pelvis_position_m, "the option bvh_up_axis")
    labels = labels_for(path, times_s, truth.pelvis_position_m)
    return Recording(
        name=path.stem,
        source=str(path),
        kind="motion capture",
        times_s=times_s,
        truth=truth,
        measured=None,
        has_robot=False,
        labels=replace(labels, description="; ".join(filter(None, (labels.description, note)))),
    )


def _without_rest_frame(bvh: Bvh) -> tuple[Bvh, str]:
    """Leave out a first frame in the rest pose, told by rotations of exactly 0 and a leap to the second.

    Returns:
        The file and a note for its description, empty where nothing was left out.
    """
    is_rotation = np.array([channel.endswith("rotation") for joint in bvh.joints for channel in joint.channels])
    if len(bvh.motion) < 2 or not is_rotation.any() or bvh.motion[0, is_rotation].any():
        return bvh, ""
    leap_deg = np.abs((bvh.motion[1, is_rotation] + 180.0) % 360.0 - 180.0).max()
    if leap_deg <= _REST_FRAME_JUMP_DEG:
        return bvh, ""
    return replace(bvh, motion=bvh.motion[1:]), "first frame (rest pose) left out"


def _up_axis(path: Path, wanted: str | None, head_position: FloatArray, hips_position: FloatArray) -> FloatArray:
    """Unit vector of the file's axis that points up, shape (3,).

    It is where the head is from the hips in the motion, not in the rest pose: some files keep their skeleton
    along another axis and turn it upright in every frame.
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


def _unit_m(path: Path, bvh: Bvh, up: FloatArray, rest_up: FloatArray) -> float:
    """Metres per file unit, from the person's height in the motion or, if that fits none, the rest pose."""
    rest = rest_positions(bvh.joints)
    ends = [index for index, joint in enumerate(bvh.joints) if joint.end_offset is not None]
    end_offsets = {index: np.asarray(bvh.joints[index].end_offset) for index in ends}
    sampled = poses(bvh, range(len(bvh.joints)), slice(None, None, max(1, len(bvh.motion) // _HEIGHT_SAMPLES)))
    in_motion = [position for _, position in sampled.values()]
    in_motion += [sampled[index][1] + sampled[index][0].apply(offset) for index, offset in end_offsets.items()]
    height = float(np.median(np.ptp(np.array(in_motion) @ up, axis=0)))
    in_rest = np.vstack([rest, *(rest[index] + offset for index, offset in end_offsets.items())])
    rest_height = float(np.ptp(in_rest @ rest_up))
    low_m, high_m = _STANDING_HEIGHT_RANGE_M
    for units_high in (height, rest_height):
        for unit_m in _UNITS_M.values():
            if low_m <= units_high * unit_m <= high_m:
                return unit_m
    candidates = ", ".join(f"{name} ({unit_m:.6g})" for name, unit_m in _UNITS_M.items())
    raise RecordingError(
        path,
        "HIERARCHY",
        f"the person is {height:.4g} units high ({rest_height:.4g} in the rest pose), in no known unit "
        f"{low_m:g} to {high_m:g} m",
        f"one of the units {candidates}, or the option bvh_unit_m",
    )


def _check_size(path: Path, truth: Track, unit_m: float) -> None:
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


def _out_from_file(up: FloatArray) -> FloatArray:
    """Rotation from the file's axes to ones with z up, shape (3, 3); with y up, z becomes x."""
    forward = np.roll(np.abs(up), 1)
    return np.vstack([forward, np.cross(up, forward), up])


def _quat_wxyz(out_from_file: FloatArray, file_from_joint: Rotation, person_axes: FloatArray) -> FloatArray:
    """Orientation of a joint's person axes in the output frame, shape (N, 4)."""
    turned = Rotation.from_matrix(out_from_file) * file_from_joint * Rotation.from_matrix(person_axes)
    return np.asarray(turned.as_quat()[:, [3, 0, 1, 2]])
