"""Everything that happened in one run, in one file that numpy reads; the shapes of its arrays are checked when read."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Literal, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gazempc.errors import SettingsError, shown
from gazempc.files.bounds import check_file
from gazempc.files.npz import read_npz
from gazempc.files.whole import write_whole
from gazempc.neck.spec import NeckSpec
from gazempc.results.tables import LogFrames, frames_of
from gazempc.types import BoolArray, FloatArray, IntArray, StringArray

_REASON_SHOWN = 400
FORECAST_HORIZONS_S = (0.25, 0.5, 1.0)


class RunInfo(BaseModel):
    """Description of a run; it is kept in the log.

    Attributes:
        recording: Name of the recording; of a live run its source.
        kind: Kind of data, such as ``synthetic``; ``live`` for a person in front of the robot.
        subject: The person.
        group: Route group, None where it is not known.
        controller: Name of the controller.
        predictor: Name of the predictor.
        neck: The neck that moved.
        sensor: The sensor's specification; of a live run its name only.
        seed: Seed of the simulated noise.
        mode: ``replay`` in simulated time, ``live`` on a clock.
        robot: Name of the robot.
        joints: ``true`` if the log holds where the joints were, known in simulation only; ``measured`` if it holds
            what a robot reported.
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
        """Whether the true head is known, as in replays; in a live run it is not."""
        return self.kind != "live"

    def as_json(self) -> str:
        """JSON text, keys sorted: equal runs give equal texts."""
        return json.dumps(self.model_dump(), sort_keys=True)


@dataclass(frozen=True)
class Fault:
    """An exception that the loop survived.

    Attributes:
        event: Name of the event in the log.
        count: Number of times that it came.
        error: The first exception in one line, such as ``TypeError: ...``.
        traceback: Its traceback.
    """

    event: str
    count: int
    error: str
    traceback: str

    @property
    def line(self) -> str:
        """In one line, such as ``forecast_failed (412 x): TypeError: ...``."""
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
        head_true_base_m: True head, shape (M, 3), metres; NaN where it is not known.
        joint_time_s: Time of the newest joint reading at each tick, shape (M,), seconds; NaN if the robot did not
            answer.
        joint_position_rad: Angles of the joints at each tick, shape (M, N), radians, in the order of
            `NeckSpec.joint_names` (pan, tilt, then eyes and body). True angles of a simulated neck, else readings.
        joint_velocity_rad_s: Shape (M, N), rad/s.
        command_position_rad: Commands sent at each tick, shape (M, N), radians.
        command_velocity_rad_s: Shape (M, N), rad/s.
        command_acceleration_rad_s2: Shape (M, N), rad/s^2.
        capture_time_s: Capture times of the observations that were used, shape (F,), seconds; in the order of arrival.
        arrival_time_s: Times of their arrival, shape (F,), seconds.
        head_observed_base_m: Observed heads, shape (F, 3), metres.
        person_id: The sensor's names of the observed people, shape (F,); an empty text if there is no name.
        forecast_mean_base_m: Forecast after each observation at each of `forecast_horizon_s` from its capture,
            shape (F, 3, 3): observation, horizon, axis; NaN where there was none.
        forecast_covariance_m2: Shape (F, 3, 3, 3), square metres.
        forecast_degrees_of_freedom: Those of the t distribution that each forecast states, shape (F,); infinite for a
            normal one, NaN where there was no forecast.
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
        faults: The exceptions that were survived, each event once; as JSON text in the file.
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
        """Ticks at which the gaze is to be elsewhere than on the person, shape (M,)."""
        away = np.zeros(self.time_s.size, dtype=np.bool_)
        for start_s, end_s in zip(self.away_start_s.tolist(), self.away_end_s.tolist(), strict=True):
            away |= (self.time_s >= start_s) & (self.time_s <= end_s)
        return away

    @property
    def neck(self) -> NeckSpec:
        """The neck that moved."""
        return self.run.neck

    def save(self, path: Path | str | BinaryIO) -> None:
        """Write the log; equal logs give equal files to the last bit.

        Args:
            path: File to write, ending in ``.npz``, or an open one.
        """
        arrays: dict[str, Any] = {
            f.name: np.asarray(getattr(self, f.name)) for f in fields(self) if f.name not in _TEXT
        }
        arrays["run"] = np.asarray(self.run.as_json())
        arrays["faults"] = np.asarray(json.dumps([vars(fault) for fault in self.faults]))
        if isinstance(path, Path | str):
            write_whole(Path(path), lambda file: np.savez_compressed(file, **arrays))
        else:
            np.savez_compressed(path, **arrays)

    def to_pandas(self) -> LogFrames:
        """The log as pandas tables of ticks, observations, forecasts and events.

        Returns:
            The tables; `run` and `faults` are not in them.

        Raises:
            ImportError: If pandas is not installed (extra ``pandas``).
        """
        return frames_of(vars(self))


_TEXT = ("run", "faults")
SHAPES: Mapping[str, tuple[str | int, ...]] = {
    name: hint.__metadata__ for name, hint in get_type_hints(Log, include_extras=True).items() if name not in _TEXT
}


@dataclass(frozen=True)
class ComputeTimes:
    """Computing times; kept apart from the log, because they differ from run to run.

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


# Larger numbers than any second since 1970 or any metre are damage, and their squares would overflow.
_LARGEST = 1e12
# No run holds still for so long, and no reading is so old.
_LONGEST_GAP_S = 60.0
_KINDS = {"person_id": "U", "event_name": "U", "attended_why": "U", "away_why": "U", "attended_person": "i"}
_FINITE = ("time_s", "command_position_rad", "capture_time_s", "arrival_time_s", "event_time_s")


def check_shapes(path: Path | str, values: Mapping[str, Any], joints: int, horizons_s: Sequence[float]) -> None:
    """Refuse arrays of inconsistent kinds or lengths, and ticks that do not follow each other.

    Args:
        path: File, for messages.
        values: The arrays by name.
        joints: Number of joints of the neck.
        horizons_s: Horizons at which logs have forecasts, seconds.

    Raises:
        SettingsError: Names the array.
    """
    counts: dict[str | int, int] = {"J": joints}
    for name, axes in SHAPES.items():
        array = values[name]
        if array.size and array.dtype.kind != _KINDS.get(name, "f"):
            raise _damaged(path, name, f"it holds {array.dtype}")
        if array.ndim != len(axes):
            raise _damaged(path, name, f"its shape is {array.shape}, expected {_said(axes)}")
        for axis, length in zip(axes, array.shape, strict=True):
            known = axis if isinstance(axis, int) else counts.setdefault(axis, length)
            if length != known:
                raise _damaged(path, name, f"its shape is {array.shape}, expected {_said(axes)} with {axis} = {known}")
        may_be_infinite = name == "forecast_degrees_of_freedom"  # of a normal distribution
        if array.dtype.kind == "f" and not may_be_infinite and (np.abs(array) > _LARGEST).any():
            raise _damaged(path, name, f"it has values beyond {_LARGEST:g}")
        if name in _FINITE and not np.isfinite(array).all():
            raise _damaged(path, name, "it has values that are not finite")
    if not np.array_equal(values["forecast_horizon_s"], horizons_s):
        raise _damaged(path, "forecast_horizon_s", f"expected are {', '.join(map(str, horizons_s))} s")
    time_s, joint_time_s = values["time_s"], values["joint_time_s"]
    steps_s = np.diff(time_s)
    if not ((steps_s > 0.0) & (steps_s < _LONGEST_GAP_S)).all():
        raise _damaged(path, "time_s", f"the times do not increase by less than {_LONGEST_GAP_S:g} s each")
    if time_s.size and (np.abs(joint_time_s - np.clip(joint_time_s, time_s[0], time_s[-1])) > _LONGEST_GAP_S).any():
        raise _damaged(path, "joint_time_s", f"a time is more than {_LONGEST_GAP_S:g} s from all ticks")


def _said(axes: tuple[str | int, ...]) -> str:
    return f"({', '.join(map(str, axes))})"


def _damaged(path: Path | str, name: str, problem: str) -> SettingsError:
    return SettingsError(f"{path}: {name}: {problem}: not a log that can be used")


# The first bytes of every MCAP file.
MAGIC = b"\x89MCAP0\r\n"
ATTACHMENT = "log.npz"
# The names of attachments stand in the summary at a file's end.
_SUMMARY_BYTES = 2**20
NEEDS_VIEW = 'MCAP files need more packages: pip install -e ".[view]"'


def has_log(path: Path) -> bool:
    """Whether an MCAP file is a log of this package, and not a bag of ROS 2; needs no other package.

    Args:
        path: The file.

    Returns:
        True if an attachment of a log's name is in it; False, too, if there is no such file.
    """
    try:
        check_file(path)
        with path.open("rb") as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(max(0, size - _SUMMARY_BYTES))
            return ATTACHMENT.encode() in file.read()
    except OSError:
        return False


def is_mcap(path: Path) -> bool:
    """Whether a file begins as MCAP files do.

    Args:
        path: The file.

    Returns:
        True if it does.

    Raises:
        OSError: If it cannot be read, or is no regular file.
    """
    check_file(path)
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def attached_log(path: Path) -> bytes:
    """The log in an MCAP file, as it was saved.

    Args:
        path: The file.

    Returns:
        Bytes of `gazempc.results.log.Log.save`.

    Raises:
        SettingsError: If a package is missing, the file cannot be read, or no log is in it.
    """
    try:
        from mcap.reader import make_reader  # noqa: PLC0415  (optional)
    except ImportError:
        raise SettingsError(NEEDS_VIEW) from None
    try:
        check_file(path)
        with path.open("rb") as file:
            found = [each.data for each in make_reader(file).iter_attachments() if each.name == ATTACHMENT]
    except Exception as error:  # a damaged file makes the library raise errors of many unrelated classes
        raise SettingsError(f"{path}: not an MCAP file that can be read: {shown(str(error), 200)}") from None
    if not found:
        raise SettingsError(f"{path}: no log of gazempc is in this MCAP file")
    return bytes(found[0])


def load_log(path: Path | str) -> Log:
    """Read a log.

    Args:
        path: File written by `Log.save`, or an MCAP file (extra ``view``).

    Returns:
        The log.

    Raises:
        SettingsError: If the file is missing or not a log.
    """
    try:
        values = read_npz(attached_log(Path(path)) if is_mcap(Path(path)) else Path(path))
    except (OSError, ValueError) as error:
        reason = error.strerror or error if isinstance(error, OSError) else error
        raise SettingsError(f"{path}: not a log that can be read: {reason}") from None
    wanted = {f.name for f in fields(Log)}
    if missing := sorted(wanted - set(values)):
        older = "; an older version wrote it: replay the recording again" if "about" in values else ""
        raise SettingsError(f"{path}: not a gazempc log, it lacks {', '.join(missing)}{older}")
    try:
        values["run"] = RunInfo.model_validate(json.loads(str(values["run"])))
        values["faults"] = tuple(Fault(**fault) for fault in json.loads(str(values["faults"])))
    except (ValidationError, ValueError, TypeError, RecursionError) as error:
        raise SettingsError(
            f"{path}: the description of the run cannot be read: {shown(str(error), _REASON_SHOWN)}"
        ) from None
    check_shapes(path, values, values["run"].neck.joints, FORECAST_HORIZONS_S)
    return Log(**{name: values[name] for name in wanted})


_ONCE = ("run", "forecast_horizon_s", "faults")


def join_logs(logs: Sequence[Log]) -> Log:
    """Join logs of one run.

    Args:
        logs: At least one, in the order of time.

    Returns:
        One log; an event that lasted over an end begins once more after it.

    Raises:
        ValueError: If there is none.
    """
    if not logs:
        raise ValueError("nothing to join: needed is at least one log")
    joined: dict[str, Any] = {
        f.name: np.concatenate([getattr(log, f.name) for log in logs]) for f in fields(Log) if f.name not in _ONCE
    }
    return replace(logs[0], **joined, faults=merge_faults(fault for log in logs for fault in log.faults))


def merge_faults(faults: Iterable[Fault]) -> tuple[Fault, ...]:
    """Faults of several logs.

    Args:
        faults: In the order of time.

    Returns:
        Each event once: its first exception, and how often it came in all.
    """
    merged: dict[str, Fault] = {}
    for fault in faults:
        first = merged.get(fault.event)
        merged[fault.event] = fault if first is None else replace(first, count=first.count + fault.count)
    return tuple(merged.values())
