"""A log as tables: one column a number, one table a rate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

Columns = dict[str, NDArray[Any]]
_AXES = ("x", "y", "z")
# The upper triangle of a covariance.
_PAIRS = [(i, j) for i in range(3) for j in range(i, 3)]


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
    covariances = log["forecast_covariance_m2"].reshape(each, 3, 3)
    return {
        "ticks": {
            "time_s": log["time_s"],
            **_split("head_true_{}_base_m", log["head_true_base_m"], _AXES),
            "joint_time_s": log["joint_time_s"],
            **_split("joint_{}_rad", log["joint_position_rad"], joints),
            **_split("joint_{}_rad_s", log["joint_velocity_rad_s"], joints),
            **_split("command_{}_rad", log["command_position_rad"], joints),
            **_split("command_{}_rad_s", log["command_velocity_rad_s"], joints),
            **_split("command_{}_rad_s2", log["command_acceleration_rad_s2"], joints),
        },
        "observations": {
            "capture_time_s": log["capture_time_s"],
            "arrival_time_s": log["arrival_time_s"],
            **_split("head_observed_{}_base_m", log["head_observed_base_m"], _AXES),
            "person_id": log["person_id"],
        },
        "forecasts": {
            "capture_time_s": np.repeat(log["capture_time_s"], horizons_s.size),
            "horizon_s": np.tile(horizons_s, means.shape[0]),
            **_split("mean_{}_base_m", means.reshape(each, 3), _AXES),
            **{f"covariance_{_AXES[i]}{_AXES[j]}_m2": covariances[:, i, j] for i, j in _PAIRS},
            "degrees_of_freedom": np.repeat(log["forecast_degrees_of_freedom"], horizons_s.size),
            **_split("head_true_{}_base_m", true.reshape(each, 3), _AXES),
        },
        "events": {"time_s": log["event_time_s"], "event": log["event_name"]},
    }


def frames_of(log: Mapping[str, Any]) -> LogFrames:
    """Tables of a log in pandas.

    Args:
        log: Values of the fields of a `gazempc.results.log.Log`, by name.

    Returns:
        The tables.

    Raises:
        ImportError: If pandas is not installed.
    """
    try:
        import pandas as pd  # noqa: PLC0415  (optional)
    except ImportError:
        raise ImportError('tables of a log need pandas: pip install "gazempc[pandas]"') from None
    return LogFrames(**{name: pd.DataFrame(columns) for name, columns in log_tables(log).items()})


def _split(name: str, values: NDArray[Any], parts: tuple[str, ...]) -> Columns:
    return {name.format(part): values[:, k] for k, part in enumerate(parts)}
