"""Logs made by hand, of runs among several people and of looks away."""

from dataclasses import replace

import numpy as np

from builders.replays import run_info
from gazempc.results.log import FORECAST_HORIZONS_S, Log

TICK_S = 0.005
COMMANDS = (
    "joint_velocity_rad_s", "command_position_rad", "command_velocity_rad_s", "command_acceleration_rad_s2"
)  # fmt: skip


def attention_log(error_deg, attended=(), away=(), swaps_s=(), **about):
    """A gaze that is so far off a head straight ahead at each tick.

    `attended` has times, numbers and whys; `away` has beginnings, ends and whys.
    """
    count, horizons = len(error_deg), len(FORECAST_HORIZONS_S)
    joints = np.column_stack([np.deg2rad(error_deg), np.zeros(count)])
    times_s, numbers, whys = zip(*attended, strict=True) if attended else ((), (), ())
    starts_s, ends_s, reasons = zip(*away, strict=True) if away else ((), (), ())
    time_s = TICK_S * np.arange(count)
    return Log(
        run=run_info(**about),
        time_s=time_s,
        head_true_base_m=np.tile([2.0, 0.0, 0.0], (count, 1)),
        joint_time_s=time_s,
        joint_position_rad=joints,
        joint_velocity_rad_s=np.zeros_like(joints),
        command_position_rad=joints,
        command_velocity_rad_s=np.zeros_like(joints),
        command_acceleration_rad_s2=np.zeros_like(joints),
        capture_time_s=np.empty(0),
        arrival_time_s=np.empty(0),
        head_observed_base_m=np.empty((0, 3)),
        person_id=np.array([], dtype=np.str_),
        forecast_mean_base_m=np.empty((0, horizons, 3)),
        forecast_covariance_m2=np.empty((0, horizons, 3, 3)),
        forecast_degrees_of_freedom=np.empty(0),
        forecast_true_base_m=np.empty((0, horizons, 3)),
        forecast_horizon_s=np.array(FORECAST_HORIZONS_S),
        event_time_s=np.empty(0),
        event_name=np.array([], dtype=np.str_),
        attended_time_s=np.array(times_s, dtype=np.float64),
        attended_person=np.array(numbers, dtype=np.intp),
        attended_why=np.array(whys, dtype=np.str_),
        away_start_s=np.array(starts_s, dtype=np.float64),
        away_end_s=np.array(ends_s, dtype=np.float64),
        away_why=np.array(reasons, dtype=np.str_),
        identity_swap_time_s=np.array(swaps_s, dtype=np.float64),
    )


def of_motion(log, time_s, joints_rad, head_base_m, **changes):
    """The log with other ticks, at which the joints are read, and a command at rest."""
    still = dict.fromkeys(COMMANDS, np.zeros_like(joints_rad))
    moved = {"time_s": time_s, "joint_time_s": time_s, "joint_position_rad": joints_rad}
    return replace(log, **{"head_true_base_m": head_base_m, **moved, **still, **changes})


def error_in(seconds, off_deg, *contacts_s):
    """An error at each tick that is 0 within these spans, and `off_deg` else."""
    time_s = TICK_S * np.arange(round(seconds / TICK_S) + 1)
    inside = np.zeros(time_s.size, dtype=bool)
    for from_s, to_s in contacts_s:
        inside |= (time_s >= from_s - 1e-9) & (time_s < to_s - 1e-9)
    return np.where(inside, 0.0, off_deg)
