"""Channels for viewers, in an MCAP file or over a socket: moments of a run in; frames, scenes and numbers out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove import channels
from foxglove import messages as fox

from gazempc.errors import SettingsError
from gazempc.neck.kinematics import gaze_error_rad
from gazempc.results import mcap_scene as scene
from gazempc.results import moments
from gazempc.results.log import ATTACHMENT, FORECAST_HORIZONS_S, RunInfo
from gazempc.results.tables import FORECAST_COLUMNS, OBSERVATION_COLUMNS, tick_columns
from gazempc.types import FloatArray, JointState


class McapWriter:
    """Writes all messages of its context to a file, until closed.

    Args:
        run: Description of the run; kept in the file's metadata.
        path: File to write; an existing one is replaced.

    Attributes:
        context: Context of the channels.

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
            name: Name of the metadata.
            about: Content.
        """
        self._writer.write_metadata(name, about)

    def flush(self) -> None:
        """Flush to the operating system: the messages so far survive a crash of this program."""
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
            SettingsError: If the file cannot be written.
        """
        try:
            self._writer.close()
        except (OSError, RuntimeError) as error:
            raise SettingsError(f"{self._path}: cannot be written: {error}") from None


# Scenes are written at 50 Hz, numbers at every tick.
_SCENE_PERIOD_S = 0.02
_ABOUT_NOW_S = 1e-6
_UNKNOWN = np.full(3, np.nan)
METRICS = ("gaze_error_deg", "gaze_to_observed_deg", "late_ms", "skipped_ticks", "latency_ms")


class Channels:
    """Messages of one run.

    Args:
        run: Description of the run.
        context: Writes or serves the messages.
    """

    def __init__(self, run: RunInfo, context: foxglove.Context) -> None:
        self._neck, self._camera, self._context = run.neck, scene.camera_frame(run), context
        names = run.neck.joint_names
        self._ticks = self._numbers("/ticks", tick_columns(names))
        self._observations = self._numbers("/observations", OBSERVATION_COLUMNS)
        self._forecasts = self._numbers("/forecasts", FORECAST_COLUMNS)
        self._metrics = self._numbers("/metrics", ("time_s", *METRICS))
        knots = {f"{name}_rad": {"type": "array", "items": {"type": "number"}} for name in names}
        self._attended = self._json("/attended", {"person": {"type": "integer"}, "why": {"type": "string"}})
        self._plans = self._json("/plan", {"start_s": {"type": "number"}, "step_s": {"type": "number"}, **knots})
        self._frames = channels.FrameTransformsChannel("/tf", context=context)
        self._joints = channels.JointStatesChannel("/joints", context=context)
        self._commands = channels.JointStatesChannel("/commands", context=context)
        self._scene = channels.SceneUpdateChannel("/scene", context=context)
        self._events = channels.LogChannel("/events", context=context)
        self._pictures = channels.CompressedImageChannel("/camera", context=context)
        self._true_joints: JointState | None = None
        self._late: moments.LateMoment | None = None
        self._observed_base_m: FloatArray = _UNKNOWN
        self._latency_ms = math.nan
        self._scene_due_s = -math.inf

    def _json(self, topic: str, properties: dict[str, Any]) -> foxglove.Channel:
        # Named fields, which viewers can plot before the first message.
        schema = {"type": "object", "properties": properties}
        return foxglove.Channel(topic, schema=schema, context=self._context)

    def _numbers(self, topic: str, columns: Sequence[str]) -> Callable[[Sequence[Any], int], None]:
        """Open a channel of rows; returns its send function of row and time in nanoseconds."""
        channel = self._json(topic, {name: {"type": "string" if name == "person_id" else "number"} for name in columns})

        def send(row: Sequence[Any], at: int) -> None:
            # JSON has no NaN and no infinity.
            known = [None if isinstance(value, float) and not math.isfinite(value) else value for value in row]
            channel.log(dict(zip(columns, known, strict=True)), log_time=at)

        return send

    def write(self, moment: moments.Moment) -> None:
        """Write a moment.

        Args:
            moment: The moment.
        """
        match moment:
            case moments.TickMoment():
                self._tick(moment)
            case moments.JointsMoment():
                self._true_joints = moment.joints
            case moments.LateMoment():
                self._late = moment
            case moments.SeenMoment():
                self._seen(moment)
            case moments.PlanMoment():
                self._plan(moment)
            case moments.EventMoment(time_s, name, text):
                warned = fox.Log(timestamp=scene.stamp(time_s), level=fox.LogLevel.Warning, message=text, name=name)
                self._events.log(warned, log_time=scene.nanoseconds(time_s))
            case moments.PictureMoment(time_s, jpeg):
                taken, frame = scene.stamp(time_s), self._camera.child
                picture = fox.CompressedImage(timestamp=taken, frame_id=frame, data=jpeg, format="jpeg")
                self._pictures.log(picture, log_time=scene.nanoseconds(time_s))
            case moments.AttendedMoment(time_s, person, why):
                self._attended.log({"person": person, "why": why}, log_time=scene.nanoseconds(time_s))

    def _tick(self, tick: moments.TickMoment) -> None:
        at, nowhere = scene.nanoseconds(tick.time_s), np.full(self._neck.joints, np.nan)
        joints = self._true_joints or tick.joints or JointState(math.nan, nowhere, nowhere)
        head_m = _UNKNOWN if tick.head_true_base_m is None else tick.head_true_base_m
        _, speeds, accelerations = zip(*tick.motions, strict=True)
        read = (joints.time_s, *joints.position_rad.tolist(), *joints.velocity_rad_s.tolist())
        self._ticks((tick.time_s, *head_m.tolist(), *read, *tick.sent_rad.tolist(), *speeds, *accelerations), at)
        errors = np.rad2deg(
            gaze_error_rad(self._neck.geometry, joints.position_rad, np.stack([head_m, self._observed_base_m]))
        ).tolist()
        self._metrics((tick.time_s, *errors, *(self._late or (math.nan, math.nan)), self._latency_ms), at)
        self._true_joints = self._late = None
        behind_s = tick.time_s - self._scene_due_s
        if behind_s >= -_ABOUT_NOW_S:
            # Synchronous with the ticks despite their jitter.
            self._scene_due_s = _SCENE_PERIOD_S + (tick.time_s if behind_s > _SCENE_PERIOD_S else self._scene_due_s)
            self._draw(tick, joints, head_m, at)

    def _draw(self, tick: moments.TickMoment, joints: JointState, head_m: FloatArray, at: int) -> None:
        def states(*columns: Sequence[float]) -> fox.JointStates:
            rows = zip(self._neck.joint_names, *columns, strict=True)
            fields = ("name", "position", "velocity", "acceleration")
            joined = [fox.JointState(**dict(zip(fields, row, strict=False))) for row in rows]
            return fox.JointStates(timestamp=scene.stamp(tick.time_s), joints=joined)

        _, speeds, accelerations = zip(*tick.motions, strict=True)
        self._commands.log(states(tick.sent_rad.tolist(), speeds, accelerations), log_time=at)
        entities: list[fox.SceneEntity] = []
        if np.isfinite(joints.position_rad).all():
            self._joints.log(states(joints.position_rad.tolist(), joints.velocity_rad_s.tolist()), log_time=at)
            frames = [*scene.neck_frames(self._neck, joints.position_rad), self._camera]
            self._frames.log(scene.transforms(frames, tick.time_s), log_time=at)
            entities.append(scene.gaze_entity(self._neck.geometry, joints.position_rad, tick.time_s))
        if np.isfinite(head_m).all():
            entities.append(scene.person_entity("person", head_m, tick.time_s))
        if entities:
            self._scene.log(fox.SceneUpdate(entities=entities), log_time=at)

    def _seen(self, seen: moments.SeenMoment) -> None:
        at, head_m = scene.nanoseconds(seen.time_s), seen.head_observed_base_m
        self._observed_base_m = head_m
        self._observations((seen.capture_time_s, seen.time_s, *head_m.tolist(), seen.person_id), at)
        true_m = np.full_like(seen.means_base_m, np.nan) if seen.true_base_m is None else seen.true_base_m
        i, j = np.triu_indices(3)
        for k, horizon_s in enumerate(FORECAST_HORIZONS_S):
            stated = *seen.means_base_m[k].tolist(), *seen.covariances_m2[k, i, j].tolist(), seen.degrees_of_freedom
            self._forecasts((seen.capture_time_s, horizon_s, *stated, *true_m[k].tolist()), at)
        self._frames.log(scene.transforms([scene.person_frame(head_m, seen.head_quat_wxyz)], seen.time_s), log_time=at)
        entities = [scene.person_entity("observed", head_m, seen.time_s)]
        if np.isfinite(seen.means_base_m).all():
            entities.append(scene.forecast_entity(seen.means_base_m, seen.covariances_m2, seen.time_s))
        self._scene.log(fox.SceneUpdate(entities=entities), log_time=at)

    def _plan(self, plan: moments.PlanMoment) -> None:
        self._latency_ms = plan.latency_ms
        at = scene.nanoseconds(plan.time_s)
        angles = {f"{name}_rad": plan.position_rad[:, k].tolist() for k, name in enumerate(self._neck.joint_names)}
        self._plans.log({"start_s": plan.start_s, "step_s": plan.step_s, **angles}, log_time=at)
        drawn = scene.plan_entity(self._neck.geometry, plan.position_rad, plan.time_s)
        self._scene.log(fox.SceneUpdate(entities=[drawn]), log_time=at)
