"""Reads a log from an .npz or MCAP file, and validates its arrays; writes it as MCAP.

An MCAP file has channels for viewers, and the whole log, exact to the last bit, as an attachment. It is written with
foxglove-sdk and read with the `mcap` library; both are in the extra ``view``.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
from pydantic import ValidationError

from gazempc.errors import SettingsError, importing, shown
from gazempc.files.bounds import check_file
from gazempc.files.npz import read_npz
from gazempc.files.whole import whole
from gazempc.results.log import ATTACHMENT, FORECAST_HORIZONS_S, Fault, Log, RunInfo
from gazempc.results.moments import PlanMoment, moments_of

_REASON_SHOWN = 400
# Plausibility bound, beyond any Unix time or position: squares of larger numbers may overflow.
_LARGEST = 1e12
# Upper bound of the time between two ticks, and of the age of a reading.
_LONGEST_GAP_S = 60.0
_FINITE = ("time_s", "command_position_rad", "capture_time_s", "arrival_time_s", "event_time_s")
# The first bytes of every MCAP file.
MAGIC = b"\x89MCAP0\r\n"
# Names of attachments are in the summary at the end of a file.
_SUMMARY_BYTES = 2**20
NEEDS_VIEW = 'MCAP files need more packages: pip install -e ".[view]"'
SHAPES: Mapping[str, tuple[str | int, ...]] = {
    name: hint.__metadata__
    for name, hint in get_type_hints(Log, include_extras=True).items()
    if name not in ("run", "faults")  # JSON text in the file
}
# Names in logs of earlier versions, by array: old and new.
_RENAMED = {"event_name": ("nobody_attended", "no_person_attended"), "attended_why": ("nobody", "no_person")}
_KINDS = {"person_id": "U", "event_name": "U", "attended_why": "U", "away_why": "U", "attended_person": "i"}


def check_shapes(path: Path | str, values: Mapping[str, Any], joints: int, horizons_s: Sequence[float]) -> None:
    """Validate types and shapes of arrays, and the order of ticks.

    Args:
        path: File, for messages.
        values: The arrays by name.
        joints: Number of joints of the neck.
        horizons_s: Horizons at which logs have forecasts, seconds.

    Raises:
        SettingsError: If an array is invalid; names it.
    """
    if not np.size(values["time_s"]):
        raise _damaged(path, "time_s", "it is empty, expected one tick or more")
    counts = {"J": joints}
    for name, axes in SHAPES.items():
        array = values[name]
        if array.size and array.dtype.kind != _KINDS.get(name, "f"):
            raise _damaged(path, name, f"its type is {array.dtype}")
        shape = tuple(
            axis if isinstance(axis, int) else counts.setdefault(axis, length)
            for axis, length in zip(axes, array.shape, strict=False)
        )
        if array.shape != shape or len(axes) != len(shape):
            wanted = f"({', '.join(map(str, axes))}) with {', '.join(f'{k} = {n}' for k, n in counts.items())}"
            raise _damaged(path, name, f"its shape is {array.shape}, expected {wanted}")
        # Degrees of freedom of a normal distribution are infinite.
        if array.dtype.kind == "f" and name != "forecast_degrees_of_freedom" and (np.abs(array) > _LARGEST).any():
            raise _damaged(path, name, f"it has values beyond {_LARGEST:g}")
        if name in _FINITE and not np.isfinite(array).all():
            raise _damaged(path, name, "it has values that are not finite")
    if not np.array_equal(values["forecast_horizon_s"], horizons_s):
        raise _damaged(path, "forecast_horizon_s", f"expected {', '.join(map(str, horizons_s))} s")
    time_s, joint_time_s = values["time_s"], values["joint_time_s"]
    steps_s = np.diff(time_s)
    if not ((steps_s > 0.0) & (steps_s < _LONGEST_GAP_S)).all():
        raise _damaged(path, "time_s", f"the times do not increase by less than {_LONGEST_GAP_S:g} s each")
    if time_s.size and (np.abs(joint_time_s - np.clip(joint_time_s, time_s[0], time_s[-1])) > _LONGEST_GAP_S).any():
        raise _damaged(path, "joint_time_s", f"a time is more than {_LONGEST_GAP_S:g} s from all ticks")


def _damaged(path: Path | str, name: str, problem: str) -> SettingsError:
    return SettingsError(f"{path}: {name}: {problem}: not a valid log")


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


def attached_log(path: Path) -> bytes:
    """The log in an MCAP file, as it was saved.

    Args:
        path: The file.

    Returns:
        Bytes of `gazempc.results.log.Log.save`.

    Raises:
        MissingOptionalDependencyError: If a package is missing.
        SettingsError: If the file cannot be read, or no log is in it.
    """
    with importing("reading MCAP files", "mcap", "view"):
        from mcap.reader import make_reader  # noqa: PLC0415
    try:
        check_file(path)
        with path.open("rb") as file:
            found = [each.data for each in make_reader(file).iter_attachments() if each.name == ATTACHMENT]
    except Exception as error:  # a damaged file makes the library raise errors of many unrelated classes
        raise SettingsError(f"{path}: not a readable MCAP file: {shown(str(error), 200)}") from None
    if not found:
        raise SettingsError(f"{path}: no log of gazempc is in this MCAP file")
    return bytes(found[0])


def read_arrays(path: Path | str) -> dict[str, Any]:
    """Arrays of a log or of a record of a neck, by name.

    Args:
        path: An ``.npz`` file, or an MCAP file with a log (extra ``view``).

    Returns:
        The arrays, unchecked.

    Raises:
        SettingsError: If the file cannot be read.
    """
    path = Path(path)
    try:
        check_file(path)
        with path.open("rb") as file:
            is_mcap = file.read(len(MAGIC)) == MAGIC
        return dict(read_npz(attached_log(path) if is_mcap else path))
    except (OSError, ValueError) as error:
        raise SettingsError(f"{path}: not a readable log: {getattr(error, 'strerror', None) or error}") from None


def load_log(path: Path | str) -> Log:
    """Read a log.

    Args:
        path: File written by `Log.save`, or an MCAP file (extra ``view``).

    Returns:
        The log.

    Raises:
        SettingsError: If the file is missing or not a log.
    """
    values = read_arrays(path)
    wanted = {f.name for f in fields(Log)}
    if missing := sorted(wanted - set(values)):
        raise SettingsError(f"{path}: not a gazempc log of this version, it lacks {', '.join(missing)}")
    try:
        values["run"] = RunInfo.model_validate(json.loads(str(values["run"])))
        values["faults"] = tuple(Fault(**fault) for fault in json.loads(str(values["faults"])))
    except (ValidationError, ValueError, TypeError, RecursionError) as error:
        raise SettingsError(
            f"{path}: the description of the run cannot be read: {shown(str(error), _REASON_SHOWN)}"
        ) from None
    check_shapes(path, values, values["run"].neck.joints, FORECAST_HORIZONS_S)
    for name, (old, new) in _RENAMED.items():
        values[name] = np.where(values[name] == old, new, values[name])
    return Log(**{name: values[name] for name in wanted})


def write_mcap(log: Log, path: Path | str, plans: Sequence[PlanMoment] = ()) -> None:
    """Write a log as MCAP.

    The channels are those of `gazempc.results.mcap_channels.Channels`. A log has neither plans, lateness nor pictures.

    Args:
        log: The log.
        path: File to write; an existing one is replaced.
        plans: The plans of the run, if available.

    Raises:
        MissingOptionalDependencyError: If a package is missing.
        SettingsError: If the file cannot be written.
    """
    with importing("writing MCAP files", "foxglove-sdk", "view"):
        from gazempc.results.mcap_channels import Channels, McapWriter  # noqa: PLC0415
    buffer = io.BytesIO()
    log.save(buffer)
    with whole(Path(path)) as part, closing(McapWriter(log.run, part)) as writer:
        channels = Channels(log.run, writer.context)
        for moment in moments_of(log, plans):
            channels.write(moment)
        writer.attach(buffer.getvalue())
