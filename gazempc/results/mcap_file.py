"""A log as an MCAP file: channels that viewers show, and the whole log, exact to the last bit, as an attachment.

Written with foxglove-sdk, read with the `mcap` library; both are in the extra ``view``. Foxglove, rerun and PlotJuggler
open the file.
"""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gazempc.errors import SettingsError
from gazempc.results.log import Log
from gazempc.results.mcap_read import ATTACHMENT, NEEDS_VIEW, nanoseconds
from gazempc.results.metrics import gaze_error_deg
from gazempc.results.tables import log_tables

if TYPE_CHECKING:
    import foxglove

# Scenes are for the eye: at 200 ticks a second every fourth one is enough. Numbers come at every tick.
_SCENE_HZ = 50.0
# Faster than a schema for each: a viewer plots any number of a JSON message.
_SCHEMA = {"type": "object"}


def write_mcap(log: Log, path: Path | str) -> None:
    """Write a log as MCAP.

    Channels: ``/tf`` (base, pan, tilt, eye, person), ``/joints``, ``/ticks``, ``/observations``, ``/forecasts``,
    ``/metrics``, ``/scene`` (person, forecast with ellipsoids of two standard deviations, gaze), ``/events``.

    Args:
        log: The log.
        path: File to write; an old one is replaced.

    Raises:
        SettingsError: If a package is missing or the file cannot be written.
    """
    try:
        import foxglove  # noqa: PLC0415  (optional)
    except ImportError:
        raise SettingsError(NEEDS_VIEW) from None
    context = foxglove.Context()
    try:
        with foxglove.open_mcap(path, allow_overwrite=True, context=context) as writer:
            writer.write_metadata("gazempc", {"run": log.run.as_json()})
            writer.attach(
                log_time=0, create_time=0, name=ATTACHMENT, media_type="application/octet-stream", data=_as_npz(log)
            )
            _write_numbers(log, context)
            _write_scenes(log, context)
            _write_events(log, context)
    except OSError as error:
        raise SettingsError(f"{path}: cannot be written: {error}") from None


def _as_npz(log: Log) -> bytes:
    buffer = io.BytesIO()
    log.save(buffer)
    return buffer.getvalue()


def _write_numbers(log: Log, context: foxglove.Context) -> None:
    import foxglove  # noqa: PLC0415

    tables = log_tables(vars(log))
    tables["metrics"] = {"time_s": log.time_s, "gaze_error_deg": gaze_error_deg(log)}
    arrived_s = np.repeat(log.arrival_time_s, log.forecast_horizon_s.size)
    times = {"observations": log.arrival_time_s, "forecasts": arrived_s}
    for name in ("ticks", "observations", "forecasts", "metrics"):
        columns = tables[name]
        channel = foxglove.Channel(f"/{name}", schema=_SCHEMA, context=context)
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        for time_s, row in zip(times.get(name, log.time_s).tolist(), rows, strict=True):
            message = {key: _known(value) for key, value in zip(columns, row, strict=True)}
            channel.log(message, log_time=nanoseconds(time_s))


def _write_scenes(log: Log, context: foxglove.Context) -> None:
    from foxglove.channels import FrameTransformsChannel, JointStatesChannel, SceneUpdateChannel  # noqa: PLC0415
    from foxglove.messages import JointState, JointStates, SceneUpdate  # noqa: PLC0415

    from gazempc.results.mcap_scene import (  # noqa: PLC0415  (needs foxglove)
        forecast_entity,
        gaze_entity,
        person_entity,
        stamp,
        transforms,
    )

    frames = FrameTransformsChannel("/tf", context=context)
    joints = JointStatesChannel("/joints", context=context)
    scene = SceneUpdateChannel("/scene", context=context)
    every = max(1, round(log.neck.servo_rate_hz / _SCENE_HZ))
    seen = np.searchsorted(log.arrival_time_s, log.time_s, side="right") - 1
    shown = -1
    for k in range(0, log.time_s.size, every):
        time_s, angles_rad = float(log.time_s[k]), log.joint_position_rad[k]
        at = nanoseconds(time_s)
        if np.isfinite(angles_rad).all():
            speeds = log.joint_velocity_rad_s[k].tolist()
            states = [
                JointState(name=name, position=q, velocity=v)
                for name, q, v in zip(("pan", "tilt"), angles_rad.tolist(), speeds, strict=True)
            ]
            joints.log(JointStates(timestamp=stamp(time_s), joints=states), log_time=at)
            frames.log(transforms(log.neck.geometry, angles_rad, time_s), log_time=at)
            scene.log(SceneUpdate(entities=[gaze_entity(log.neck.geometry, angles_rad, time_s)]), log_time=at)
        if np.isfinite(log.head_true_base_m[k]).all():
            scene.log(SceneUpdate(entities=[person_entity("person", log.head_true_base_m[k], time_s)]), log_time=at)
        if seen[k] > shown:
            shown = int(seen[k])
            entities = [person_entity("observed", log.head_observed_base_m[shown], time_s)]
            if np.isfinite(log.forecast_mean_base_m[shown]).all():
                entities.append(
                    forecast_entity(log.forecast_mean_base_m[shown], log.forecast_covariance_m2[shown], time_s)
                )
            scene.log(SceneUpdate(entities=entities), log_time=at)


def _write_events(log: Log, context: foxglove.Context) -> None:
    from foxglove.channels import LogChannel  # noqa: PLC0415
    from foxglove.messages import Log as Message  # noqa: PLC0415
    from foxglove.messages import LogLevel  # noqa: PLC0415

    from gazempc.results.mcap_scene import stamp  # noqa: PLC0415

    texts = {fault.event: fault.line for fault in log.faults}
    channel = LogChannel("/events", context=context)
    for time_s, event in zip(log.event_time_s.tolist(), log.event_name.tolist(), strict=True):
        message = Message(
            timestamp=stamp(time_s), level=LogLevel.Warning, message=texts.get(event, event), name="gazempc"
        )
        channel.log(message, log_time=nanoseconds(time_s))


def _known(value: Any) -> Any:
    # JSON has no NaN and no infinity.
    return None if isinstance(value, float) and not math.isfinite(value) else value
