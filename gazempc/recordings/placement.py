"""Placement of the robot: transforms a recording to the robot's base frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import PlacementError
from gazempc.recordings.recording import Recording, Track, turned
from gazempc.types import FloatArray

Placement = Literal["recorded", "side"]

_NEAREST_M = 0.8
# Minimum displacement for a direction of travel; below it the robot is placed in front of the face.
_STANDING_M = 0.1


def place(recording: Recording, placement: Placement, distance_m: float, height_m: float) -> Recording:
    """Transform a recording to the base frame of a robot.

    With ``recorded`` the recording's frame is the robot's base frame: the robot stands where the sensor stood, or, if
    there was no sensor, at the origin.
    With ``side`` the robot stands beside the walk, at ``c + distance (z x d)``, and faces c. Here c is the mean head
    position, and d is the horizontal direction from the first head position to the farthest one.

    Args:
        recording: Any recording.
        placement: Placement of the robot.
        distance_m: Distance of ``side`` from the mean head position, metres.
        height_m: Height of ``side`` above the recording's floor (z = 0), metres.

    Returns:
        The same recording with positions and orientations in the base frame, and time starting at 0.

    Raises:
        PlacementError: If the head comes within 0.8 m (horizontally) of a robot that was absent from the recording.
    """
    return place_together((recording,), placement, distance_m, height_m)[0]


def place_together(
    recordings: Sequence[Recording], placement: Placement, distance_m: float, height_m: float
) -> tuple[Recording, ...]:
    """Transform recordings in one frame and on one clock to the base frame of a robot; see `place`.

    Args:
        recordings: One recording per person.
        placement: Placement of the robot; ``side`` is beside the first one.
        distance_m: As in `place`.
        height_m: As in `place`.

    Returns:
        The recordings in the base frame; time 0 is the start of the earliest.

    Raises:
        PlacementError: As in `place`.
    """
    start_s = min(float(recording.times_s[0]) for recording in recordings)
    beside = placement == "side"
    base_m, yaw_rad = _beside(recordings[0].truth, distance_m, height_m) if beside else (np.zeros(3), 0.0)
    every = []
    for recording in recordings:
        placed = replace(
            recording,
            times_s=recording.times_s - start_s,
            truth=_to_base(recording.truth, base_m, yaw_rad),
            measured=None if recording.measured is None else _to_base(recording.measured, base_m, yaw_rad),
            has_robot=True,
        )
        nearest_m = float(np.nanmin(np.hypot(*placed.truth.head_position_m.T[:2])))
        if nearest_m < _NEAREST_M and (beside or not recording.has_robot):
            where = f"{distance_m} m beside the walk" if beside else "at the origin of the recording"
            cure = "a larger distance_m" if beside else "placement side"
            problem = f"the head comes within {nearest_m:.2f} m of a robot that stands {where}"
            raise PlacementError(f"{recording.name}: {problem}; at least {_NEAREST_M} m are needed: use {cure}")
        every.append(placed)
    return tuple(every)


def _beside(track: Track, distance_m: float, height_m: float) -> tuple[FloatArray, float]:
    heads = track.head_position_m[track.valid]
    away = heads[:, :2] - heads[0, :2]
    reach_m = np.linalg.norm(away, axis=1)
    far = int(np.argmax(reach_m))
    d = away[far] / max(reach_m[far], _STANDING_M)
    to_robot = _facing(track) if reach_m[far] < _STANDING_M else np.array([-d[1], d[0]])  # z x d
    centre = np.mean(heads, axis=0)
    base_m = np.array([*(centre[:2] + distance_m * to_robot), height_m])
    return base_m, float(np.arctan2(-to_robot[1], -to_robot[0]))


def _facing(track: Track) -> FloatArray:
    """Horizontal direction of the first face; +x if it is unknown or vertical."""
    known = track.head_quat_wxyz[np.isfinite(track.head_quat_wxyz).all(axis=1)]
    first = Rotation.from_quat(known[0], scalar_first=True) if len(known) else Rotation.identity()
    forward = first.apply([1.0, 0.0, 0.0])[:2]
    length = float(np.linalg.norm(forward))
    return np.asarray(forward / length if length > 1e-3 else [1.0, 0.0])


def _to_base(track: Track, base_m: FloatArray, yaw_rad: float) -> Track:
    to_base = Rotation.from_euler("z", -yaw_rad).as_matrix().T
    return Track(
        head_position_m=(track.head_position_m - base_m) @ to_base,
        head_quat_wxyz=turned(track.head_quat_wxyz, -yaw_rad),
        pelvis_position_m=(track.pelvis_position_m - base_m) @ to_base,
        pelvis_quat_wxyz=turned(track.pelvis_quat_wxyz, -yaw_rad),
    )
