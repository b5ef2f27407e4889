"""Recordings from arrays in memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gazempc.errors import RecordingError
from gazempc.recordings.readers.checks import check_finite, check_unit_quaternions, recording_of
from gazempc.recordings.recording import Labels, Recording, Track
from gazempc.types import FloatArray


def recording_from_arrays(
    name: str,
    times_s: ArrayLike,
    head_position_m: ArrayLike,
    *,
    head_quat_wxyz: ArrayLike | None = None,
    pelvis_position_m: ArrayLike | None = None,
    pelvis_quat_wxyz: ArrayLike | None = None,
    in_base_frame: bool = False,
) -> Recording:
    """Build a recording from arrays, for `gazempc.replay`.

    Args:
        name: Name of the recording; the subject is its part up to the first underscore.
        times_s: Capture times, shape (N,), seconds, increasing.
        head_position_m: True positions of the head, shape (N, 3), metres, z up.
        head_quat_wxyz: Orientations of the head, shape (N, 4), or (4,) if constant; the identity faces +x. Default:
            unknown, and not measured by simulated sensors.
        pelvis_position_m: Positions of the pelvis, shape (N, 3), metres; default: unknown.
        pelvis_quat_wxyz: Orientations of the pelvis, as `head_quat_wxyz`.
        in_base_frame: Whether the frame's origin is the robot's sensor, x forward, y left. Otherwise the floor is z =
            0, and `gazempc.replay` places the robot beside the walk.

    Returns:
        The recording.

    Raises:
        RecordingError: If a shape is wrong, a value is not finite, times do not increase, times or positions are in
            another unit, or a quaternion is not of unit length; names the array, the row and the accepted values.
    """
    times = _array(name, "times_s", times_s, ("N",))
    head_m = _array(name, "head_position_m", head_position_m, (times.size, 3))
    pelvis_m = np.full_like(head_m, np.nan)
    if pelvis_position_m is not None:
        pelvis_m = _array(name, "pelvis_position_m", pelvis_position_m, (times.size, 3))
    track = Track(
        head_position_m=head_m,
        head_quat_wxyz=_quats(name, "head_quat_wxyz", head_quat_wxyz, times.size),
        pelvis_position_m=pelvis_m,
        pelvis_quat_wxyz=_quats(name, "pelvis_quat_wxyz", pelvis_quat_wxyz, times.size),
    )
    labels = Labels(subject=name.partition("_")[0])
    found = recording_of(Path(name), times, track, "motion capture", in_base_frame, "row {}".format, labels=labels)
    return replace(found, name=name, source="arrays")


def _array(name: str, field: str, value: ArrayLike, shape: tuple[int | str, ...]) -> FloatArray:
    accepted = f"an array of numbers of shape ({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise RecordingError(name, field, "its values are not numbers", accepted) from None
    fits = array.ndim == len(shape) and all(n in ("N", size) for n, size in zip(shape, array.shape, strict=True))
    if not fits:
        raise RecordingError(name, field, f"its shape is {array.shape}", accepted)
    rows = array.reshape(len(array), -1)
    check_finite(Path(name), rows, [field] * rows.shape[1], "row {}".format)
    return array


def _quats(name: str, field: str, value: ArrayLike | None, frames: int) -> FloatArray:
    if value is None:
        return np.full((frames, 4), np.nan)
    quats = np.asarray(value)
    quats = _array(name, field, np.tile(quats, (frames, 1)) if quats.shape == (4,) else quats, (frames, 4))
    check_unit_quaternions(Path(name), quats, field, "row {}".format)
    return np.asarray(quats / np.linalg.norm(quats, axis=1, keepdims=True), dtype=np.float64)
