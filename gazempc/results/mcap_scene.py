"""Frames and drawn entities of a scene, as messages of Foxglove."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from foxglove import messages as fox
from scipy.spatial.transform import Rotation

from gazempc.neck.kinematics import gaze_ray
from gazempc.neck.spec import Geometry, NeckSpec
from gazempc.results.log import RunInfo
from gazempc.types import FloatArray

BASE = "base"
_HERE = (0.0, 0.0, 0.0)


class PlacedFrame(NamedTuple):
    """Pose of a frame in its parent frame.

    Attributes:
        parent: Name of the parent frame.
        child: Name of the frame.
        position_m: Origin in the parent frame, metres.
        turn: Orientation in the parent frame.
    """

    parent: str
    child: str
    position_m: Sequence[float]
    turn: Rotation


def nanoseconds(time_s: float) -> int:
    """A time in whole nanoseconds, as in MCAP files; negative times become 0."""
    return max(0, round(1e9 * time_s))


def stamp(time_s: float) -> fox.Timestamp:
    """A time as a message's stamp; negative times become 0."""
    seconds, rest = divmod(nanoseconds(time_s), 10**9)
    return fox.Timestamp(sec=seconds, nsec=rest)


def neck_frames(neck: NeckSpec, angles_rad: FloatArray) -> list[PlacedFrame]:
    """Frames of the neck: base, body (where it turns), pan, tilt, eye.

    Args:
        neck: The neck.
        angles_rad: Angles of all joints in the order of `NeckSpec.joint_names`, shape (N,), radians.

    Returns:
        Each frame in the previous one; the x axis of ``eye`` is the line of sight.
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
        run: Description of the run. A live run has the mounting pose of its sensor; the sensor of a replay is at the
            base's origin, or on the tilt axis if it moves with the head.

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
        quat_wxyz: Its orientation, shape (4,); None if not observed: then the base's.

    Returns:
        The frame ``person`` in the base.
    """
    turn = Rotation.identity() if quat_wxyz is None else Rotation.from_quat(quat_wxyz, scalar_first=True)
    return PlacedFrame(BASE, "person", head_base_m.tolist(), turn)


def transforms(frames: Sequence[PlacedFrame], time_s: float) -> fox.FrameTransforms:
    """Frames as a message.

    Args:
        frames: The frames.
        time_s: The time, seconds.

    Returns:
        The message.
    """
    return fox.FrameTransforms(
        transforms=[
            fox.FrameTransform(
                timestamp=stamp(time_s),
                parent_frame_id=frame.parent,
                child_frame_id=frame.child,
                translation=_vector(frame.position_m),
                rotation=_quaternion(frame.turn),
            )
            for frame in frames
        ]
    )


def _quaternion(turn: Rotation) -> fox.Quaternion:
    return fox.Quaternion(**dict(zip("xyzw", turn.as_quat().tolist(), strict=True)))


def _vector(xyz: Sequence[float]) -> fox.Vector3:
    return fox.Vector3(**dict(zip("xyz", xyz, strict=True)))


# Diameters of true and observed head; the observed one is smaller, so that both are visible.
_HEAD_M, _OBSERVED_M = 0.2, 0.1
# A full axis of a 2-sigma ellipsoid is four standard deviations long.
_AXIS_SDS = 4.0
_GAZE_LENGTH_M = 4.0
# Okabe & Ito (2008): for colour-blind people, too.
_TRUE, _SEEN = fox.Color(r=0.0, g=0.62, b=0.45, a=0.8), fox.Color(r=0.9, g=0.62, b=0.0, a=0.9)
_FORECAST, _CLOUD = fox.Color(r=0.0, g=0.45, b=0.7, a=1.0), fox.Color(r=0.34, g=0.71, b=0.91, a=0.25)
_GAZE, _PLAN = fox.Color(r=0.84, g=0.37, b=0.0, a=1.0), fox.Color(r=0.8, g=0.47, b=0.65, a=1.0)


def person_entity(name: str, head_base_m: FloatArray, time_s: float) -> fox.SceneEntity:
    """A head: ``person`` at the true position, ``observed`` at the measured one.

    Args:
        name: ``person`` or ``observed``.
        head_base_m: Position, shape (3,), metres.
        time_s: The time, seconds.

    Returns:
        A sphere.
    """
    size_m, colour = (_HEAD_M, _TRUE) if name == "person" else (_OBSERVED_M, _SEEN)
    sphere = fox.SpherePrimitive(pose=_pose(head_base_m), size=_vector([size_m] * 3), color=colour)
    return _entity(name, time_s, spheres=[sphere])


def forecast_entity(means_base_m: FloatArray, covariances_m2: FloatArray, time_s: float) -> fox.SceneEntity:
    """A forecast as a line, with ellipsoids of two standard deviations.

    Args:
        means_base_m: Positions, shape (H, 3), metres.
        covariances_m2: Their covariances, shape (H, 3, 3), square metres.
        time_s: The time, seconds.

    Returns:
        The line and its ellipsoids.
    """
    spheres = [_ellipsoid(mean, cov) for mean, cov in zip(means_base_m, covariances_m2, strict=True)]
    return _entity("forecast", time_s, lines=[_line(means_base_m, _FORECAST)], spheres=spheres)


def gaze_entity(geometry: Geometry, angles_rad: FloatArray, time_s: float) -> fox.SceneEntity:
    """The gaze as a ray of 4 m.

    Args:
        geometry: The neck's geometry.
        angles_rad: Angles of all joints, shape (N,), radians.
        time_s: The time, seconds.

    Returns:
        A line from the eye.
    """
    eye, direction = gaze_ray(geometry, angles_rad)
    return _entity("gaze", time_s, lines=[_line(np.stack([eye, eye + _GAZE_LENGTH_M * direction]), _GAZE)])


def plan_entity(geometry: Geometry, planned_rad: FloatArray, time_s: float) -> fox.SceneEntity:
    """A plan as the path of the gaze ray's end point.

    Args:
        geometry: The neck's geometry.
        planned_rad: Commanded angles at the knots, shape (K, N), radians.
        time_s: The time, seconds.

    Returns:
        The line.
    """
    eyes, directions = gaze_ray(geometry, planned_rad)
    return _entity("plan", time_s, lines=[_line(eyes + _GAZE_LENGTH_M * directions, _PLAN)])


def _ellipsoid(mean_m: FloatArray, covariance_m2: FloatArray) -> fox.SpherePrimitive:
    finite = np.isfinite(covariance_m2).all()
    variances, axes = np.linalg.eigh(covariance_m2) if finite else (np.zeros(3), np.eye(3))
    if np.linalg.det(axes) < 0:
        axes = -axes
    size = (_AXIS_SDS * np.sqrt(np.maximum(variances, 0.0))).tolist()
    return fox.SpherePrimitive(pose=_pose(mean_m, Rotation.from_matrix(axes)), size=_vector(size), color=_CLOUD)


def _entity(name: str, time_s: float, **drawn: Any) -> fox.SceneEntity:
    # An entity replaces the previous one of the same name.
    return fox.SceneEntity(timestamp=stamp(time_s), frame_id=BASE, id=name, lifetime=fox.Duration(sec=0), **drawn)


def _line(points_m: FloatArray, colour: fox.Color) -> fox.LinePrimitive:
    points = [fox.Point3(x=x, y=y, z=z) for x, y, z in points_m.tolist()]
    return fox.LinePrimitive(
        type=fox.LinePrimitiveLineType.LineStrip, thickness=2.0, scale_invariant=True, points=points, color=colour
    )


def _pose(position_m: FloatArray, turn: Rotation | None = None) -> fox.Pose:
    return fox.Pose(position=_vector(position_m.tolist()), orientation=_quaternion(turn or Rotation.identity()))
