"""Frames that viewers place things in: base, body, pan, tilt, eye, camera and person."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from foxglove.messages import FrameTransform, FrameTransforms, Quaternion, Timestamp, Vector3
from scipy.spatial.transform import Rotation

from gazempc.neck.spec import NeckSpec
from gazempc.results.mcap_read import nanoseconds
from gazempc.results.run_info import RunInfo
from gazempc.types import FloatArray

BASE = "base"
_HERE = (0.0, 0.0, 0.0)


class PlacedFrame(NamedTuple):
    """A frame in another one.

    Attributes:
        parent: Name of the other one.
        child: Its name.
        position_m: Its origin there, metres.
        turn: Its orientation there.
    """

    parent: str
    child: str
    position_m: Sequence[float]
    turn: Rotation


def stamp(time_s: float) -> Timestamp:
    """A time as messages have it; none before zero."""
    seconds, rest = divmod(nanoseconds(time_s), 10**9)
    return Timestamp(sec=seconds, nsec=rest)


def neck_frames(neck: NeckSpec, angles_rad: FloatArray) -> list[PlacedFrame]:
    """Frames of the neck: base, body (where it turns), pan, tilt, eye.

    Args:
        neck: The neck.
        angles_rad: Angles of all joints in the order of `NeckSpec.joint_names`, shape (N,), radians.

    Returns:
        Each in the one before; ``eye`` looks along its x axis.
    """
    at = dict(zip(neck.joint_names, angles_rad.tolist(), strict=True))
    # Tilting up turns +x towards +z: about -y.
    eyes = [at.get("eye_pan", 0.0), -at.get("eye_tilt", 0.0)]
    body = [PlacedFrame(BASE, "body", _HERE, Rotation.from_euler("z", at["body_yaw"]))] if "body_yaw" in at else []
    return [
        *body,
        PlacedFrame("body" if body else BASE, "pan", _HERE, Rotation.from_euler("z", at["pan"])),
        PlacedFrame("pan", "tilt", neck.geometry.tilt_axis_in_pan_m, Rotation.from_euler("y", -at["tilt"])),
        PlacedFrame("tilt", "eye", neck.geometry.eye_in_tilt_m, Rotation.from_euler("ZY", eyes)),
    ]


def camera_frame(run: RunInfo) -> PlacedFrame:
    """Frame of the sensor: x along its view, y left, z up.

    Args:
        run: What the run was. A live run says where its sensor was; the sensor of a replay is in the base's origin, or
            on the tilt axis if it moves with the head.

    Returns:
        The frame in ``base``, ``tilt`` or ``eye``.
    """
    mount = run.settings.get("mount") or {}
    on = mount.get("on") or (run.sensor.get("view") or {}).get("on", "base")
    turn = Rotation.from_euler("xyz", mount.get("roll_pitch_yaw_deg", _HERE), degrees=True)
    parent = {"head": "tilt", "eye": "eye"}.get(on, BASE)
    return PlacedFrame(parent, "camera", mount.get("position_m", _HERE), turn)


def person_frame(head_base_m: FloatArray, quat_wxyz: FloatArray | None) -> PlacedFrame:
    """Frame of the observed head.

    Args:
        head_base_m: Its position, shape (3,), metres.
        quat_wxyz: Its orientation, shape (4,); None where it was not observed: then that of the base.

    Returns:
        The frame ``person`` in the base.
    """
    turn = Rotation.identity() if quat_wxyz is None else Rotation.from_quat(quat_wxyz, scalar_first=True)
    return PlacedFrame(BASE, "person", head_base_m.tolist(), turn)


def transforms(frames: Sequence[PlacedFrame], time_s: float) -> FrameTransforms:
    """Frames as a message.

    Args:
        frames: The frames.
        time_s: The time, seconds.

    Returns:
        The message.
    """
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=stamp(time_s),
                parent_frame_id=frame.parent,
                child_frame_id=frame.child,
                translation=Vector3(x=frame.position_m[0], y=frame.position_m[1], z=frame.position_m[2]),
                rotation=_quaternion(frame.turn),
            )
            for frame in frames
        ]
    )


def _quaternion(turn: Rotation) -> Quaternion:
    x, y, z, w = turn.as_quat().tolist()
    return Quaternion(x=x, y=y, z=z, w=w)
