"""Recordings from motion capture as BVH, of any skeleton that has a head and two sides.

The parser is our own: the one maintained library (bvhio 1.5.4) never returns on a file that is cut off and
reads numbers in single precision.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.recordings.readers.bvh_motion import Pose, poses
from gazempc.recordings.readers.bvh_parse import Bvh, parse_bvh
from gazempc.recordings.readers.bvh_scale import check_size, scale_of, up_axis
from gazempc.recordings.readers.bvh_skeleton import direction, find_skeleton, head_tip, person_axes_in_rest
from gazempc.recordings.readers.checks import check_frame_count, check_frame_interval
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.position_checks import check_upright
from gazempc.recordings.recording import Recording, Track
from gazempc.types import FloatArray

_REST_FRAME_JUMP_DEG = 30.0


def read_bvh(path: Path, options: ReadOptions) -> Recording:
    """Read a BVH file.

    The head is the tip of the head's bone where the file has one. Orientations are those of the joints'
    bones, so that in the rest pose head and hips face where the person faces. A first frame that only shows
    the rest pose (common in conversions of the CMU database) is left out.

    Args:
        path: File to read.
        options: Unit, frame rate, head and hips joints, facing and up axis, where what is inferred is wrong.

    Returns:
        The recording; time starts at 0. Its notes say in one line what was inferred.

    Raises:
        RecordingError: If the file is damaged, or head, facing, unit or up axis is in doubt; names the option that
            decides.
    """
    bvh, note = _without_rest_frame(parse_bvh(path))
    count = len(bvh.motion)
    check_frame_count(path, count)
    skeleton = find_skeleton(path, bvh.joints, options.bvh_head_joint, options.bvh_hips_joint)
    head, hips = skeleton.head, skeleton.hips
    tip, tip_offset = head_tip(bvh.joints, head)
    pose_of = poses(bvh, {head, hips, tip}, slice(None))
    head_position = pose_of[tip][1] + pose_of[tip][0].apply(tip_offset)
    hips_position = pose_of[hips][1]
    way = _way(pose_of[hips], np.linalg.norm(head_position - hips_position, axis=1))
    person_axes, told = person_axes_in_rest(path, bvh.joints, skeleton, options.bvh_facing, way)
    up = up_axis(path, options.bvh_up_axis, head_position, hips_position)
    scale = scale_of(path, bvh, hips, up, person_axes[:, 2], options.bvh_unit_m)
    out_from_file = _out_from_file(up)
    truth = Track(
        head_position_m=np.asarray(head_position @ out_from_file.T * scale.unit_m),
        head_quat_wxyz=_quat_wxyz(out_from_file, pose_of[head][0], person_axes),
        pelvis_position_m=np.asarray(hips_position @ out_from_file.T * scale.unit_m),
        pelvis_quat_wxyz=_quat_wxyz(out_from_file, pose_of[hips][0], person_axes),
        valid=np.ones(count, dtype=np.bool_),
    )
    rate_hz = options.bvh_frame_rate_hz
    times_s = np.arange(count, dtype=np.float64) * (bvh.frame_time_s if rate_hz is None else 1.0 / rate_hz)
    check_frame_interval(path, times_s)
    check_size(path, truth, scale.unit_m)
    check_upright(path, truth.head_position_m, truth.pelvis_position_m, "the option bvh_up_axis")
    labels = labels_for(path, times_s, truth.pelvis_position_m)
    point = "tip of its bone" if tip != head or tip_offset.any() else "the joint"
    inferred = (
        f"read as: {scale.said}, {direction(up)} up, head {bvh.joints[head].name} "
        f"({', '.join(filter(None, (point, skeleton.how)))}), hips {bvh.joints[hips].name}, "
        f"facing {direction(person_axes[:, 0])} at rest ({told}), {1.0 / np.diff(times_s[:2])[0]:.4g} frames a second; "
        "the options bvh_unit_m, bvh_up_axis, bvh_head_joint, bvh_hips_joint, bvh_facing, bvh_frame_rate_hz change it"
    )
    return Recording(
        name=path.stem,
        source=str(path),
        kind="motion capture",
        times_s=times_s,
        truth=truth,
        measured=None,
        has_robot=False,
        labels=replace(labels, description="; ".join(filter(None, (labels.description, note)))),
        notes=(inferred,),
    )


def _way(hips: Pose, size: FloatArray) -> FloatArray | None:
    """Direction of travel as the hips see it, in the rest pose's axes, shape (3,); None for who stays where they are.

    Args:
        hips: Their N rotations and positions.
        size: From hips to head, shape (N,), file units: a walk is longer than that.
    """
    turns, positions = hips
    way = turns[:-1].inv().apply(np.diff(positions, axis=0)).sum(axis=0)
    return way if np.linalg.norm(way) > np.median(size) else None


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


def _out_from_file(up: FloatArray) -> FloatArray:
    """Rotation from the file's axes to ones with z up, shape (3, 3); with y up, z becomes x."""
    forward = np.roll(np.abs(up), 1)
    return np.vstack([forward, np.cross(up, forward), up])


def _quat_wxyz(out_from_file: FloatArray, file_from_joint: Rotation, person_axes: FloatArray) -> FloatArray:
    """Orientation of a joint's person axes in the output frame, shape (N, 4)."""
    turned = Rotation.from_matrix(out_from_file) * file_from_joint * Rotation.from_matrix(person_axes)
    return np.asarray(turned.as_quat()[:, [3, 0, 1, 2]])
