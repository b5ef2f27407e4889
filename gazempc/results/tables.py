"""A log as tables: one column per scalar, one table per sampling rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

Columns = dict[str, NDArray[Any]]
_AXES = ("x", "y", "z")


class LogFrames(NamedTuple):
    """A log as pandas tables.

    Attributes:
        ticks: One row a servo tick: true head, joints, commands.
        observations: One row an observation that was used.
        forecasts: One row an observation and horizon: mean, covariance, true head at that time.
        events: One row an event.
    """

    ticks: pd.DataFrame
    observations: pd.DataFrame
    forecasts: pd.DataFrame
    events: pd.DataFrame


def log_tables(log: Mapping[str, Any]) -> dict[str, Columns]:
    """Tables of a log.

    Args:
        log: Values of the fields of a `gazempc.results.log.Log`, by name.

    Returns:
        Columns by name, with their units, of ``ticks``, ``observations``, ``forecasts`` and ``events``.
    """
    horizons_s, joints = log["forecast_horizon_s"], log["run"].neck.joint_names
    means, true = log["forecast_mean_base_m"], log["forecast_true_base_m"]
    each = means.shape[0] * horizons_s.size
    i, j = np.triu_indices(3)
    of_ticks = ["time_s", "head_true_base_m", "joint_time_s", "joint_position_rad", "joint_velocity_rad_s"]
    of_ticks += ["command_position_rad", "command_velocity_rad_s", "command_acceleration_rad_s2"]
    ticks = [column for name in of_ticks for column in np.atleast_2d(log[name].T)]
    observations = [log["capture_time_s"], log["arrival_time_s"], *log["head_observed_base_m"].T, log["person_id"]]
    forecasts = [
        np.repeat(log["capture_time_s"], horizons_s.size),
        np.tile(horizons_s, means.shape[0]),
        *means.reshape(each, 3).T,
        *log["forecast_covariance_m2"].reshape(each, 3, 3)[:, i, j].T,
        np.repeat(log["forecast_degrees_of_freedom"], horizons_s.size),
        *true.reshape(each, 3).T,
    ]
    return {
        "ticks": dict(zip(tick_columns(joints), ticks, strict=True)),
        "observations": dict(zip(OBSERVATION_COLUMNS, observations, strict=True)),
        "forecasts": dict(zip(FORECAST_COLUMNS, forecasts, strict=True)),
        "events": {"time_s": log["event_time_s"], "event": log["event_name"]},
    }


def tick_columns(joints: Sequence[str]) -> tuple[str, ...]:
    """Names of the columns of ``ticks``.

    Args:
        joints: Names of the joints.
    """
    of_joints = ("joint_{}_rad", "joint_{}_rad_s", "command_{}_rad", "command_{}_rad_s", "command_{}_rad_s2")
    return (
        "time_s",
        *(f"head_true_{axis}_base_m" for axis in _AXES),
        "joint_time_s",
        *(name.format(joint) for name in of_joints for joint in joints),
    )


OBSERVATION_COLUMNS = (
    "capture_time_s",
    "arrival_time_s",
    *(f"head_observed_{axis}_base_m" for axis in _AXES),
    "person_id",
)
# Upper triangle of the covariance.
FORECAST_COLUMNS = (
    "capture_time_s",
    "horizon_s",
    *(f"mean_{axis}_base_m" for axis in _AXES),
    *(f"covariance_{_AXES[i]}{_AXES[j]}_m2" for i, j in zip(*np.triu_indices(3), strict=True)),
    "degrees_of_freedom",
    *(f"head_true_{axis}_base_m" for axis in _AXES),
)
