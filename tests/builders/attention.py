"""Logs made by hand, of runs among several people and of looks away."""

from dataclasses import replace

import numpy as np

from builders.replays import run_info
from gazempc.results.log import FORECAST_HORIZONS_S, Log
from gazempc.results.log_files import SHAPES

TICK_S = 0.005
COMMANDS = (
    "joint_velocity_rad_s", "command_position_rad", "command_velocity_rad_s", "command_acceleration_rad_s2"
)  # fmt: skip


def attention_log(error_deg, attended=(), away=(), swaps_s=(), captures_s=(), **about):
    """Log of a gaze with the given error against a head straight ahead at each tick.

    `attended` has times, track numbers, reasons; `away` has starts, ends, reasons; frames arrive 0.1 s after capture.
    """
    times_s, numbers, whys = zip(*attended, strict=True) if attended else ((), (), ())
    starts_s, ends_s, reasons = zip(*away, strict=True) if away else ((), (), ())
    joints = np.column_stack([np.deg2rad(error_deg), np.zeros(len(error_deg))])
    sizes = {"M": len(error_deg), "F": len(captures_s), "J": 2, "H": len(FORECAST_HORIZONS_S), 3: 3}
    arrays = {
        name: np.full([sizes.get(axis, 0) for axis in axes], np.nan if axes[0] == "F" else 0.0)
        for name, axes in SHAPES.items()
    }
    arrays["time_s"] = arrays["joint_time_s"] = TICK_S * np.arange(len(error_deg))
    arrays["joint_position_rad"] = arrays["command_position_rad"] = joints
    arrays["head_true_base_m"][:] = [2.0, 0.0, 0.0]
    columns = {
        "capture_time_s": captures_s,
        "arrival_time_s": np.add(captures_s, 0.1),
        "person_id": np.full(len(captures_s), ""),
        "forecast_horizon_s": FORECAST_HORIZONS_S,
        "attended_time_s": times_s,
        "attended_why": np.array(whys, dtype=np.str_),
        "away_start_s": starts_s,
        "away_end_s": ends_s,
        "away_why": np.array(reasons, dtype=np.str_),
        "identity_swap_time_s": swaps_s,
    }
    arrays |= {name: np.asarray(values) for name, values in columns.items()}
    return Log(run=run_info(**about), **arrays | {"attended_person": np.array(numbers, dtype=np.intp)})


def of_motion(log, time_s, joints_rad, head_base_m, **changes):
    """The log with other tick times and joint readings, and a constant command."""
    still = dict.fromkeys(COMMANDS, np.zeros_like(joints_rad))
    moved = {"time_s": time_s, "joint_time_s": time_s, "joint_position_rad": joints_rad}
    return replace(log, **{"head_true_base_m": head_base_m, **moved, **still, **changes})


def error_in(seconds, off_deg, *contacts_s):
    """Error at each tick: 0 within these intervals, else `off_deg`."""
    time_s = TICK_S * np.arange(round(seconds / TICK_S) + 1)
    inside = np.zeros(time_s.size, dtype=bool)
    for from_s, to_s in contacts_s:
        inside |= (time_s >= from_s - 1e-9) & (time_s < to_s - 1e-9)
    return np.where(inside, 0.0, off_deg)
