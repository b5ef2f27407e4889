"""Recordings from Azure Kinect Body Tracking: `offline_processor` JSON.

The file's frame is the depth camera's (x right, y down, z forward; millimetres); a joint's own axes are +X
up, +Y where the person faces, +Z to the person's left. Both are turned to this package's: x forward, y left,
z up. The joints' axes are nowhere published as a promise, so they are checked against the face at load.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.recordings.readers.checks import (
    check_frame_count,
    check_frame_interval,
)
from gazempc.recordings.readers.kinect_json import BodyTrack, read_body
from gazempc.recordings.readers.labels import labels_for
from gazempc.recordings.readers.options import ReadOptions
from gazempc.recordings.readers.position_checks import (
    check_head_to_pelvis,
    check_upright,
)
from gazempc.recordings.readers.smoothing import MIN_SEEN_FRAMES, smoothed
from gazempc.recordings.recording import Recording, Track
from gazempc.types import FloatArray

_MAX_AXIS_ERROR_DEG = 60.0

_LEVEL_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_JOINT_FROM_PERSON = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def read_kinect(path: Path, options: ReadOptions) -> Recording:
    """Read a body tracking file.

    The robot's frame is the depth camera's place, turned level: x forward, y left, z up. Time is 0 at the
    body's first sighting; frames between sightings are kept as not valid. The measured track is the raw one;
    for the truth its positions are smoothed without lag by a cubic spline (generalised cross-validation).

    Args:
        path: File to read.
        options: Body, head joint and the camera's pitch.

    Returns:
        The recording, with the robot in its frame's origin.

    Raises:
        RecordingError: If the file is not such JSON, the body is not in it, the values are damaged or in
            other units, or the head's axes disagree with the face.
    """
    body = read_body(path, options.kinect_body_id)
    check_frame_count(path, int(body.seen.sum()), MIN_SEEN_FRAMES)
    times_s = (body.times_usec - body.times_usec[0]) * 1e-6
    check_frame_interval(path, times_s, unit="microseconds")
    head = options.kinect_head_joint.upper()
    level_from_camera = _level_from_camera(options.kinect_camera_pitch_deg)
    measured = Track(
        head_position_m=_position_m(body, head, level_from_camera),
        head_quat_wxyz=_quat_wxyz(body, head, level_from_camera),
        pelvis_position_m=_position_m(body, "PELVIS", level_from_camera),
        pelvis_quat_wxyz=_quat_wxyz(body, "PELVIS", level_from_camera),
        valid=body.seen,
    )
    seen_head_m = measured.head_position_m[body.seen]
    seen_pelvis_m = measured.pelvis_position_m[body.seen]
    check_head_to_pelvis(path, seen_head_m, seen_pelvis_m, unit="millimetres")
    check_upright(path, seen_head_m, seen_pelvis_m, "an upright person, and the camera's pitch as an option")
    _check_head_axes(path, body, head, measured.head_quat_wxyz, level_from_camera)
    truth = Track(
        head_position_m=smoothed(path, times_s, measured.head_position_m, body.seen),
        head_quat_wxyz=measured.head_quat_wxyz.copy(),
        pelvis_position_m=smoothed(path, times_s, measured.pelvis_position_m, body.seen),
        pelvis_quat_wxyz=measured.pelvis_quat_wxyz.copy(),
        valid=body.seen.copy(),
    )
    return Recording(
        name=path.stem,
        source=str(path),
        kind="body tracking",
        times_s=times_s,
        truth=truth,
        measured=measured,
        has_robot=True,
        labels=labels_for(path, times_s, truth.pelvis_position_m),
    )


def _level_from_camera(pitch_deg: float) -> FloatArray:
    """Rotation from the camera's axes to level ones, shape (3, 3); the pitch is positive looking up."""
    # Looking up is a negative turn about +y (left), as a positive one takes x to -z.
    pitch = Rotation.from_euler("y", -pitch_deg, degrees=True).as_matrix()
    return np.asarray(pitch @ _LEVEL_FROM_CAMERA)


def _position_m(body: BodyTrack, joint: str, level_from_camera: FloatArray) -> FloatArray:
    """Position of a joint in the level frame, shape (N, 3), metres."""
    return np.asarray(body.position_camera_mm[joint] @ level_from_camera.T * 1e-3)


def _quat_wxyz(body: BodyTrack, joint: str, level_from_camera: FloatArray) -> FloatArray:
    """Orientation of a joint's person axes in the level frame, shape (N, 4)."""
    quat_wxyz = np.full((len(body.seen), 4), np.nan)
    camera_from_joint = Rotation.from_quat(body.quat_camera_wxyz[joint][body.seen][:, [1, 2, 3, 0]])
    level_from_person = (
        Rotation.from_matrix(level_from_camera) * camera_from_joint * Rotation.from_matrix(_JOINT_FROM_PERSON)
    )
    quat_wxyz[body.seen] = level_from_person.as_quat()[:, [3, 0, 1, 2]]
    return quat_wxyz


def _check_head_axes(
    path: Path, body: BodyTrack, joint: str, head_quat_wxyz: FloatArray, level_from_camera: FloatArray
) -> None:
    """Refuse a file whose head axes are not those this reader takes for granted.

    Raises:
        RecordingError: If the head's forward axis is over 60 degrees (median) from the direction in which
            the nose is from between the ears, or its up axis over 60 degrees from up.
    """
    ears_mm = 0.5 * (body.position_camera_mm["EAR_LEFT"] + body.position_camera_mm["EAR_RIGHT"])
    face = ((body.position_camera_mm["NOSE"] - ears_mm) @ level_from_camera.T)[body.seen]
    head = Rotation.from_quat(head_quat_wxyz[body.seen][:, [1, 2, 3, 0]])
    forward_deg = _median_angle_deg(head.apply([1.0, 0.0, 0.0]), face)
    up_deg = _median_angle_deg(head.apply([0.0, 0.0, 1.0]), np.array([[0.0, 0.0, 1.0]]))
    if forward_deg >= _MAX_AXIS_ERROR_DEG or up_deg >= _MAX_AXIS_ERROR_DEG:
        raise RecordingError(
            path,
            f"joint {joint}",
            f"its forward axis is {forward_deg:.0f} deg from the face (nose minus the ears' midpoint) "
            f"and its up axis {up_deg:.0f} deg from up (medians)",
            f"both under {_MAX_AXIS_ERROR_DEG:.0f} deg, with the joint's axes +X up, +Y facing, +Z left",
        )


def _median_angle_deg(a: FloatArray, b: FloatArray) -> float:
    """Median angle between vectors, row by row, degrees."""
    cross = np.linalg.norm(np.cross(a, b), axis=1)
    return float(np.degrees(np.median(np.arctan2(cross, np.sum(a * b, axis=1)))))
