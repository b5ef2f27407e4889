"""Channels for viewers, in an MCAP file or over a socket: moments of a run in; frames, scenes and numbers out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

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
    CompressedImage,
    JointStates,
    LogLevel,
    SceneEntity,
    SceneUpdate,
)
from foxglove.messages import JointState as JointMessage
from foxglove.messages import Log as LogMessage

from gazempc.errors import SettingsError
from gazempc.neck.kinematics import gaze_error_rad
from gazempc.results.log import FORECAST_HORIZONS_S
from gazempc.results.mcap_read import ATTACHMENT, nanoseconds
from gazempc.results.mcap_scene import (
    camera_frame,
    forecast_entity,
    gaze_entity,
    neck_frames,
    person_entity,
    person_frame,
    plan_entity,
    stamp,
    transforms,
)
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
