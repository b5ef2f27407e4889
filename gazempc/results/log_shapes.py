"""Whether the arrays of a log go together, so that a damaged log is named and not computed with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gazempc.errors import SettingsError

# What each array's axes count: M ticks, J joints, F observations, H horizons, E events, A changes of who is looked at,
# W looks away, S swaps of identity. See `gazempc.results.log.Log`.
SHAPES: Mapping[str, tuple[str | int, ...]] = {
    "time_s": ("M",),
    "head_true_base_m": ("M", 3),
    "joint_time_s": ("M",),
    "joint_position_rad": ("M", "J"),
    "joint_velocity_rad_s": ("M", "J"),
    "command_position_rad": ("M", "J"),
    "command_velocity_rad_s": ("M", "J"),
    "command_acceleration_rad_s2": ("M", "J"),
    "capture_time_s": ("F",),
    "arrival_time_s": ("F",),
    "head_observed_base_m": ("F", 3),
    "person_id": ("F",),
    "forecast_mean_base_m": ("F", "H", 3),
    "forecast_covariance_m2": ("F", "H", 3, 3),
    "forecast_degrees_of_freedom": ("F",),
    "forecast_true_base_m": ("F", "H", 3),
    "forecast_horizon_s": ("H",),
    "event_time_s": ("E",),
    "event_name": ("E",),
    "attended_time_s": ("A",),
    "attended_person": ("A",),
    "attended_why": ("A",),
    "away_start_s": ("W",),
    "away_end_s": ("W",),
    "away_why": ("W",),
    "identity_swap_time_s": ("S",),
}
# Larger numbers than any second since 1970 or any metre are damage, and their squares would overflow.
_LARGEST = 1e12
# No run holds still for so long, and no reading is so old.
_LONGEST_GAP_S = 60.0
_KINDS = {"person_id": "U", "event_name": "U", "attended_why": "U", "away_why": "U", "attended_person": "i"}
_FINITE = ("time_s", "command_position_rad", "capture_time_s", "arrival_time_s", "event_time_s")


def check_shapes(path: Path | str, values: Mapping[str, Any], joints: int, horizons_s: Sequence[float]) -> None:
    """Refuse arrays of another kind or length than the others say, and ticks that do not follow each other.

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
