"""Channels for viewers, in an MCAP file or over a socket: moments of a run in; frames, scenes and numbers out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import foxglove
import numpy as np
from foxglove.channels import (
    CompressedImageChannel,
    FrameTransformsChannel,
    JointStatesChannel,
    LogChannel,
    SceneUpdateChannel,
)
from foxglove.messages import (
    Color,
    CompressedImage,
    Duration,
    FrameTransform,
    FrameTransforms,
    JointStates,
    LinePrimitive,
    LinePrimitiveLineType,
    LogLevel,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    Timestamp,
    Vector3,
)
from foxglove.messages import JointState as JointMessage
from foxglove.messages import Log as LogMessage
from scipy.spatial.transform import Rotation

from gazempc.errors import SettingsError
from gazempc.neck.kinematics import gaze_error_rad, gaze_ray
from gazempc.neck.spec import Geometry, NeckSpec
from gazempc.results.log import FORECAST_HORIZONS_S
from gazempc.results.mcap_read import ATTACHMENT, nanoseconds
from gazempc.results.moments import (
    AttendedMoment,
    EventMoment,
    JointsMoment,
    LateMoment,
    Moment,
    PictureMoment,
    PlanMoment,
    SeenMoment,
    TickMoment,
)
from gazempc.results.run_info import RunInfo
from gazempc.results.tables import forecast_columns, observation_columns, tick_columns
from gazempc.types import FloatArray, JointState


class McapWriter:
    """Writes all that is logged to its context; closes the file at the end of a ``with``.

    Args:
        run: Description of the run; kept in the file's metadata.
        path: File to write; an old one is replaced.

    Attributes:
        context: Of the channels.

    Raises:
        SettingsError: If the file cannot be written.
    """

    def __init__(self, run: RunInfo, path: Path) -> None:
        self._path = path
        self.context = foxglove.Context()
        try:
            self._writer = foxglove.open_mcap(path, allow_overwrite=True, context=self.context)
        except OSError as error:
            raise SettingsError(f"{path}: cannot be written: {error}") from None
        self.note("gazempc", {"run": run.as_json()})

    def note(self, name: str, about: dict[str, str]) -> None:
        """Write metadata.

        Args:
            name: Their name.
            about: Their content.
        """
        self._writer.write_metadata(name, about)

    def flush(self) -> None:
        """Hand over to the system what has come so far: then it is on disk if this program ends."""
        self._writer.flush()

    def attach(self, log: bytes) -> None:
        """Attach the log itself.

        Args:
            log: Bytes of `gazempc.results.log.Log.save`.
        """
        self._writer.attach(log_time=0, create_time=0, name=ATTACHMENT, media_type="application/octet-stream", data=log)

    def close(self) -> None:
        """Finish the file.

        Raises:
            SettingsError: If it cannot be written.
        """
        try:
            self._writer.close()
        except (OSError, RuntimeError) as error:
            raise SettingsError(f"{self._path}: cannot be written: {error}") from None

    def __enter__(self) -> McapWriter:
        """The writer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the file."""
        self.close()


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
        run: Description of the run. A live run has the place of its sensor; the sensor of a replay is in the base's
            origin, or on the tilt axis if it moves with the head.

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


# A head is some 0.2 m wide; what was observed is drawn smaller, so that both can be seen.
_HEAD_M, _OBSERVED_M = 0.2, 0.1
# Axes of an ellipsoid of two standard deviations are four of them long.
_AXIS_SDS = 4.0
_GAZE_LENGTH_M = 4.0
# Okabe & Ito (2008): for colour-blind people, too.
_TRUE, _SEEN = Color(r=0.0, g=0.62, b=0.45, a=0.8), Color(r=0.9, g=0.62, b=0.0, a=0.9)
_FORECAST, _CLOUD = Color(r=0.0, g=0.45, b=0.7, a=1.0), Color(r=0.34, g=0.71, b=0.91, a=0.25)
_GAZE, _PLAN = Color(r=0.84, g=0.37, b=0.0, a=1.0), Color(r=0.8, g=0.47, b=0.65, a=1.0)


def person_entity(name: str, head_base_m: FloatArray, time_s: float) -> SceneEntity:
    """A head: ``person`` where it is, ``observed`` where the sensor saw it.

    Args:
        name: ``person`` or ``observed``.
        head_base_m: Position, shape (3,), metres.
        time_s: The time, seconds.

    Returns:
        A sphere.
    """
    size_m, colour = (_HEAD_M, _TRUE) if name == "person" else (_OBSERVED_M, _SEEN)
    sphere = SpherePrimitive(pose=_pose(head_base_m), size=Vector3(x=size_m, y=size_m, z=size_m), color=colour)
    return _entity(name, time_s, spheres=[sphere])


def forecast_entity(means_base_m: FloatArray, covariances_m2: FloatArray, time_s: float) -> SceneEntity:
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


def gaze_entity(geometry: Geometry, angles_rad: FloatArray, time_s: float) -> SceneEntity:
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


def plan_entity(geometry: Geometry, planned_rad: FloatArray, time_s: float) -> SceneEntity:
    """A plan as the line along which it leads the end of the gaze ray.

    Args:
        geometry: The neck's geometry.
        planned_rad: Commanded angles at the knots, shape (K, N), radians.
        time_s: The time, seconds.

    Returns:
        The line.
    """
    eyes, directions = gaze_ray(geometry, planned_rad)
    return _entity("plan", time_s, lines=[_line(eyes + _GAZE_LENGTH_M * directions, _PLAN)])


def _ellipsoid(mean_m: FloatArray, covariance_m2: FloatArray) -> SpherePrimitive:
    finite = np.isfinite(covariance_m2).all()
    variances, axes = np.linalg.eigh(covariance_m2) if finite else (np.zeros(3), np.eye(3))
    if np.linalg.det(axes) < 0:
        axes = -axes
    x, y, z, w = Rotation.from_matrix(axes).as_quat().tolist()
    size = (_AXIS_SDS * np.sqrt(np.maximum(variances, 0.0))).tolist()
    return SpherePrimitive(
        pose=_pose(mean_m, Quaternion(w=w, x=x, y=y, z=z)),
        size=Vector3(x=size[0], y=size[1], z=size[2]),
        color=_CLOUD,
    )


def _entity(
    name: str,
    time_s: float,
    lines: list[LinePrimitive] | None = None,
    spheres: list[SpherePrimitive] | None = None,
) -> SceneEntity:
    # Each replaces the one before it of the same name.
    return SceneEntity(
        timestamp=stamp(time_s), frame_id=BASE, id=name, lifetime=Duration(sec=0), lines=lines, spheres=spheres
    )


def _line(points_m: FloatArray, colour: Color) -> LinePrimitive:
    points = [Point3(x=x, y=y, z=z) for x, y, z in points_m.tolist()]
    return LinePrimitive(
        type=LinePrimitiveLineType.LineStrip, thickness=2.0, scale_invariant=True, points=points, color=colour
    )


def _pose(position_m: FloatArray, turn: Quaternion | None = None) -> Pose:
    x, y, z = position_m.tolist()
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=turn or Quaternion(w=1.0, x=0.0, y=0.0, z=0.0))


# Scenes are for the eye: 50 a second are enough. Numbers come at every tick.
_SCENE_PERIOD_S = 0.02
_ABOUT_NOW_S = 1e-6
_UNKNOWN = np.full(3, np.nan)
METRICS = ("gaze_error_deg", "gaze_to_observed_deg", "late_ms", "skipped_ticks", "latency_ms")


class Channels:
    """Messages of one run.

    Args:
        run: Description of the run.
        context: Receives them, and writes or serves them.
    """

    def __init__(self, run: RunInfo, context: foxglove.Context) -> None:
        self._neck, self._camera = run.neck, camera_frame(run)
        names = run.neck.joint_names
        self._tick_names, self._observation_names = tick_columns(names), observation_columns()
        self._forecast_names = forecast_columns()

        def numbers(topic: str, columns: Sequence[str]) -> foxglove.Channel:
            # The fields by name, so that viewers offer them before the first message.
            fields = {name: {"type": "string" if name == "person_id" else "number"} for name in columns}
            return foxglove.Channel(topic, schema={"type": "object", "properties": fields}, context=context)

        self._ticks = numbers("/ticks", self._tick_names)
        self._observations = numbers("/observations", self._observation_names)
        self._forecasts = numbers("/forecasts", self._forecast_names)
        self._metrics = numbers("/metrics", ("time_s", *METRICS))
        knots = {f"{name}_rad": {"type": "array", "items": {"type": "number"}} for name in names}
        who = {"person": {"type": "integer"}, "why": {"type": "string"}}
        self._attended = foxglove.Channel("/attended", schema={"type": "object", "properties": who}, context=context)
        plan = {"start_s": {"type": "number"}, "step_s": {"type": "number"}, **knots}
        self._plans = foxglove.Channel("/plan", schema={"type": "object", "properties": plan}, context=context)
        self._frames = FrameTransformsChannel("/tf", context=context)
        self._joints = JointStatesChannel("/joints", context=context)
        self._commands = JointStatesChannel("/commands", context=context)
        self._scene = SceneUpdateChannel("/scene", context=context)
        self._events = LogChannel("/events", context=context)
        self._pictures = CompressedImageChannel("/camera", context=context)
        self._true_joints: JointState | None = None
        self._late: LateMoment | None = None
        self._observed_base_m: FloatArray = _UNKNOWN
        self._latency_ms = math.nan
        self._scene_due_s = -math.inf

    def write(self, moment: Moment) -> None:
        """Write what happened.

        Args:
            moment: The moment.
        """
        match moment:
            case TickMoment():
                self._tick(moment)
            case JointsMoment():
                self._true_joints = moment.joints
            case LateMoment():
                self._late = moment
            case SeenMoment():
                self._seen(moment)
            case PlanMoment():
                self._plan(moment)
            case EventMoment():
                self._event(moment)
            case PictureMoment():
                self._picture(moment)
            case AttendedMoment():
                content = {"person": moment.person, "why": moment.why}
                self._attended.log(content, log_time=nanoseconds(moment.time_s))

    def _tick(self, tick: TickMoment) -> None:
        at, joints = nanoseconds(tick.time_s), self._true_joints or tick.joints
        nowhere = np.full(self._neck.joints, np.nan)
        position_rad = nowhere if joints is None else joints.position_rad
        speed_rad_s = nowhere if joints is None else joints.velocity_rad_s
        head_m = _UNKNOWN if tick.head_true_base_m is None else tick.head_true_base_m
        _, speeds, accelerations = zip(*tick.motions, strict=True)
        row = (
            tick.time_s,
            *head_m.tolist(),
            math.nan if joints is None else joints.time_s,
            *position_rad.tolist(),
            *speed_rad_s.tolist(),
            *tick.sent_rad.tolist(),
            *speeds,
            *accelerations,
        )
        _send(self._ticks, self._tick_names, row, at)
        errors = np.rad2deg(
            gaze_error_rad(self._neck.geometry, position_rad, np.stack([head_m, self._observed_base_m]))
        ).tolist()
        late = (math.nan, math.nan) if self._late is None else self._late
        _send(self._metrics, ("time_s", *METRICS), (tick.time_s, *errors, *late, self._latency_ms), at)
        self._true_joints = self._late = None
        behind_s = tick.time_s - self._scene_due_s
        if behind_s >= -_ABOUT_NOW_S:
            # In step with the ticks, though each may come a little late.
            self._scene_due_s = _SCENE_PERIOD_S + (tick.time_s if behind_s > _SCENE_PERIOD_S else self._scene_due_s)
            self._draw(tick, joints, head_m, at)

    def _draw(self, tick: TickMoment, joints: JointState | None, head_m: FloatArray, at: int) -> None:
        names = self._neck.joint_names
        sent = [
            JointMessage(name=name, position=q, velocity=motion[1], acceleration=motion[2])
            for name, q, motion in zip(names, tick.sent_rad.tolist(), tick.motions, strict=True)
        ]
        self._commands.log(JointStates(timestamp=stamp(tick.time_s), joints=sent), log_time=at)
        entities: list[SceneEntity] = []
        if joints is not None:
            states = [
                JointMessage(name=name, position=q, velocity=v)
                for name, q, v in zip(names, joints.position_rad.tolist(), joints.velocity_rad_s.tolist(), strict=True)
            ]
            self._joints.log(JointStates(timestamp=stamp(tick.time_s), joints=states), log_time=at)
            frames = [*neck_frames(self._neck, joints.position_rad), self._camera]
            self._frames.log(transforms(frames, tick.time_s), log_time=at)
            entities.append(gaze_entity(self._neck.geometry, joints.position_rad, tick.time_s))
        if np.isfinite(head_m).all():
            entities.append(person_entity("person", head_m, tick.time_s))
        if entities:
            self._scene.log(SceneUpdate(entities=entities), log_time=at)

    def _seen(self, seen: SeenMoment) -> None:
        at, head_m = nanoseconds(seen.time_s), seen.head_observed_base_m
        self._observed_base_m = head_m
        row = (seen.capture_time_s, seen.time_s, *head_m.tolist(), seen.person_id)
        _send(self._observations, self._observation_names, row, at)
        true_m = np.full_like(seen.means_base_m, np.nan) if seen.true_base_m is None else seen.true_base_m
        i, j = np.triu_indices(3)
        for k, horizon_s in enumerate(FORECAST_HORIZONS_S):
            forecast = (
                seen.capture_time_s,
                horizon_s,
                *seen.means_base_m[k].tolist(),
                *seen.covariances_m2[k, i, j].tolist(),
                seen.degrees_of_freedom,
                *true_m[k].tolist(),
            )
            _send(self._forecasts, self._forecast_names, forecast, at)
        self._frames.log(transforms([person_frame(head_m, seen.head_quat_wxyz)], seen.time_s), log_time=at)
        entities = [person_entity("observed", head_m, seen.time_s)]
        if np.isfinite(seen.means_base_m).all():
            entities.append(forecast_entity(seen.means_base_m, seen.covariances_m2, seen.time_s))
        self._scene.log(SceneUpdate(entities=entities), log_time=at)

    def _plan(self, plan: PlanMoment) -> None:
        self._latency_ms = plan.latency_ms
        at = nanoseconds(plan.time_s)
        angles = {f"{name}_rad": plan.position_rad[:, k].tolist() for k, name in enumerate(self._neck.joint_names)}
        self._plans.log({"start_s": plan.start_s, "step_s": plan.step_s, **angles}, log_time=at)
        drawn = plan_entity(self._neck.geometry, plan.position_rad, plan.time_s)
        self._scene.log(SceneUpdate(entities=[drawn]), log_time=at)

    def _event(self, event: EventMoment) -> None:
        message = LogMessage(timestamp=stamp(event.time_s), level=LogLevel.Warning, message=event.text, name=event.name)
        self._events.log(message, log_time=nanoseconds(event.time_s))

    def _picture(self, picture: PictureMoment) -> None:
        message = CompressedImage(
            timestamp=stamp(picture.time_s), frame_id=self._camera.child, data=picture.jpeg, format="jpeg"
        )
        self._pictures.log(message, log_time=nanoseconds(picture.time_s))


def _send(channel: foxglove.Channel, names: Sequence[str], values: Sequence[Any], at: int) -> None:
    # JSON has no NaN and no infinity.
    channel.log(
        {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in zip(names, values, strict=True)
        },
        log_time=at,
    )
