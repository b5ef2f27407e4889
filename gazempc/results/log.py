"""Log of one run: ticks, observations, forecasts, events and faults, with the axes of every array."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from gazempc.errors import importing
from gazempc.files.whole import write_whole
from gazempc.neck.spec import NeckSpec
from gazempc.results.tables import LogFrames, log_tables
from gazempc.types import BoolArray, FloatArray, IntArray, StringArray

FORECAST_HORIZONS_S = (0.25, 0.5, 1.0)
# Name of a log in an MCAP file.
ATTACHMENT = "log.npz"


class RunInfo(BaseModel):
    """Description of a run; it is kept in the log.

    Attributes:
        recording: Name of the recording; for a live run its source.
        kind: Kind of data, such as ``synthetic``; ``live`` for a person in front of the robot.
        subject: The person.
        group: Route group; None if unknown.
        controller: Name of the controller.
        predictor: Name of the predictor.
        neck: Specification of the neck.
        sensor: The sensor's specification; for a live run its name only.
        seed: Seed of the simulated noise.
        mode: ``replay`` in simulated time, ``live`` on a clock.
        robot: Name of the robot.
        joints: ``true`` if the log contains true joint angles (simulation only); ``measured`` if it contains a robot's
            readings.
        settings: All settings of the run.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    recording: str
    kind: str
    subject: str
    group: str | None = None
    controller: str
    predictor: str
    neck: NeckSpec
    sensor: dict[str, Any]
    seed: int = 0
    mode: Literal["replay", "live"] = "replay"
    robot: str = "simulated"
    joints: Literal["true", "measured"] = "true"
    settings: dict[str, Any] = Field(default_factory=dict)

    @property
    def knows_true_head(self) -> bool:
        """Whether the true head is known: in replays, not in live runs."""
        return self.kind != "live"

    def as_json(self) -> str:
        """JSON text with sorted keys: equal runs give equal texts."""
        return json.dumps(self.model_dump(), sort_keys=True)


@dataclass(frozen=True)
class Fault:
    """An exception caught by the loop.

    Attributes:
        event: Name of the event in the log.
        count: Number of occurrences.
        error: The first exception in one line, such as ``TypeError: ...``.
        traceback: Its traceback.
    """

    event: str
    count: int
    error: str
    traceback: str

    @property
    def line(self) -> str:
        """The fault in one line, such as ``forecast_failed (412 x): TypeError: ...``."""
        return f"{self.event} ({self.count} x): {self.error}"


@dataclass(frozen=True)
class Log:
    """One run of one controller. Positions are in the base frame; rows of a rate share one time array.

    Saved as an ``.npz`` file with one array a field; ``numpy.load(path)`` reads it. Each field is annotated with its
    axes: M ticks, J joints, F observations, H horizons, E events, A changes of the attended person, W looks away, S
    swaps of identity.

    Attributes:
        run: Description of the run; as JSON text in the file.
        time_s: Servo ticks, shape (M,), seconds.
        head_true_base_m: True head, shape (M, 3), metres; NaN if unknown.
        joint_time_s: Time of the newest joint reading at each tick, shape (M,), seconds; NaN if the robot did not
            answer.
        joint_position_rad: Angles of the joints at each tick, shape (M, N), radians, in the order of
            `NeckSpec.joint_names` (pan, tilt, then eyes and body). True angles of a simulated neck, else readings.
        joint_velocity_rad_s: Shape (M, N), rad/s.
        command_position_rad: Commands sent at each tick, shape (M, N), radians.
        command_velocity_rad_s: Shape (M, N), rad/s.
        command_acceleration_rad_s2: Shape (M, N), rad/s^2.
        capture_time_s: Capture times of the observations that were used, shape (F,), seconds; in order of arrival.
        arrival_time_s: Times of their arrival, shape (F,), seconds.
        head_observed_base_m: Observed heads, shape (F, 3), metres.
        person_id: The sensor's names of the observed people, shape (F,); an empty text if there is no name.
        forecast_mean_base_m: Forecast after each observation at each of `forecast_horizon_s` from its capture,
            shape (F, 3, 3): observation, horizon, axis; NaN without a forecast.
        forecast_covariance_m2: Shape (F, 3, 3, 3), square metres.
        forecast_degrees_of_freedom: Degrees of freedom of each forecast's t distribution, shape (F,); infinite for a
            normal one, NaN without a forecast.
        forecast_true_base_m: True head at these times, NaN past the end of the recording, shape (F, 3, 3), metres.
        forecast_horizon_s: Shape (3,), seconds.
        event_time_s: Beginning of each event, shape (E,), seconds.
        event_name: Its name, shape (E,).
        attended_time_s: With several people: times at which the robot switched to another person, shape (A,), seconds.
        attended_person: Number of the person from this time on, in the order of entering; 0 for none; shape (A,).
        attended_why: Reason of the switch, see `gazempc.people.attention.Attended`, shape (A,).
        away_start_s: Planned end of eye contact for each look away, shape (W,), seconds.
        away_end_s: Planned return of eye contact, shape (W,), seconds.
        away_why: Reason of the look away, see `gazempc.people.aversion.Aversion`, shape (W,).
        identity_swap_time_s: In a replay with several people: first times at which one person's observations were
            assigned to another known person, shape (S,), seconds; empty in a live run.
        faults: The exceptions caught, each event once; as JSON text in the file.
    """

    run: RunInfo
    time_s: Annotated[FloatArray, "M"]
    head_true_base_m: Annotated[FloatArray, "M", 3]
    joint_time_s: Annotated[FloatArray, "M"]
    joint_position_rad: Annotated[FloatArray, "M", "J"]
    joint_velocity_rad_s: Annotated[FloatArray, "M", "J"]
    command_position_rad: Annotated[FloatArray, "M", "J"]
    command_velocity_rad_s: Annotated[FloatArray, "M", "J"]
    command_acceleration_rad_s2: Annotated[FloatArray, "M", "J"]
    capture_time_s: Annotated[FloatArray, "F"]
    arrival_time_s: Annotated[FloatArray, "F"]
    head_observed_base_m: Annotated[FloatArray, "F", 3]
    person_id: Annotated[StringArray, "F"]
    forecast_mean_base_m: Annotated[FloatArray, "F", "H", 3]
    forecast_covariance_m2: Annotated[FloatArray, "F", "H", 3, 3]
    forecast_degrees_of_freedom: Annotated[FloatArray, "F"]
    forecast_true_base_m: Annotated[FloatArray, "F", "H", 3]
    forecast_horizon_s: Annotated[FloatArray, "H"]
    event_time_s: Annotated[FloatArray, "E"]
    event_name: Annotated[StringArray, "E"]
    attended_time_s: Annotated[FloatArray, "A"]
    attended_person: Annotated[IntArray, "A"]
    attended_why: Annotated[StringArray, "A"]
    away_start_s: Annotated[FloatArray, "W"]
    away_end_s: Annotated[FloatArray, "W"]
    away_why: Annotated[StringArray, "W"]
    identity_swap_time_s: Annotated[FloatArray, "S"]
    faults: tuple[Fault, ...] = ()

    @property
    def looks_away(self) -> BoolArray:
        """Ticks of planned gaze aversion, shape (M,)."""
        away = (self.time_s >= self.away_start_s[:, None]) & (self.time_s <= self.away_end_s[:, None])
        return np.asarray(away.any(axis=0))

    @property
    def neck(self) -> NeckSpec:
        """The neck."""
        return self.run.neck

    def save(self, path: Path | str | BinaryIO) -> None:
        """Write the log; equal logs give equal files to the last bit.

        Args:
            path: File to write, ending in ``.npz``, or an open one.
        """
        texts = {"run": self.run.as_json(), "faults": json.dumps([vars(fault) for fault in self.faults])}
        arrays = {**vars(self), **texts}
        if isinstance(path, Path | str):
            write_whole(Path(path), lambda file: np.savez_compressed(file, **arrays))
        else:
            np.savez_compressed(path, **arrays)

    def to_pandas(self) -> LogFrames:
        """The log as pandas tables of ticks, observations, forecasts and events.

        Returns:
            The tables; `run` and `faults` are not in them.

        Raises:
            MissingOptionalDependencyError: If pandas is not installed (extra ``pandas``).
        """
        with importing("tables of a log", "pandas", "pandas"):
            import pandas as pd  # noqa: PLC0415
        return LogFrames(**{name: pd.DataFrame(columns) for name, columns in log_tables(vars(self)).items()})


@dataclass(frozen=True)
class ComputeTimes:
    """Computing times; stored separately from the log, as they are not reproducible.

    Attributes:
        update_ms: Predictor update of each observation, shape (F,), milliseconds.
        step_ms: Forecast and plan at each control tick, shape (C,), milliseconds.
        latency_ms: From the capture of the newest observation to the first command of each plan made with it, shape
            (P,), milliseconds; in a replay the simulated time.
    """

    update_ms: FloatArray
    step_ms: FloatArray
    latency_ms: FloatArray

    def save(self, path: Path) -> None:
        """Write the times.

        Args:
            path: File to write, ending in ``.npz``.
        """
        write_whole(path, lambda file: np.savez_compressed(file, **vars(self)))


_ONCE = ("run", "forecast_horizon_s", "faults")


def join_logs(logs: Sequence[Log]) -> Log:
    """Concatenate the logs of one run.

    Args:
        logs: At least one, in temporal order.

    Returns:
        One log; an event that spans a boundary begins again after it.
    """
    joined: dict[str, Any] = {
        f.name: np.concatenate([getattr(log, f.name) for log in logs]) for f in fields(Log) if f.name not in _ONCE
    }
    return replace(logs[0], **joined, faults=merge_faults(fault for log in logs for fault in log.faults))


def merge_faults(faults: Iterable[Fault]) -> tuple[Fault, ...]:
    """Merge the faults of several logs.

    Args:
        faults: The faults in temporal order.

    Returns:
        One fault per event: its first exception, and the total count.
    """
    merged: dict[str, Fault] = {}
    for fault in faults:
        first = merged.get(fault.event)
        merged[fault.event] = fault if first is None else replace(first, count=first.count + fault.count)
    return tuple(merged.values())
