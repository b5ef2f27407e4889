"""A standing person, and the observations of a sensor with given errors."""

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.recordings.recording import Recording, Track
from gazempc.sim.sensor import SensorSpec, observe

HEAD_M = np.array([2.4, 0.7, 0.0])


def sensor(**fields):
    """A sensor without errors but those given."""
    return SensorSpec.model_validate(
        {"name": "made here", "source": "test", "rate_hz": 30.0, "latency_s": 0.0} | fields
    )


def standing(seconds, head_m=HEAD_M, facing_away_deg=0.0, rate_hz=30.0):
    """A standing person, head and pelvis turned from the sensor by an angle."""
    times_s = np.arange(round(seconds * rate_hz)) / rate_hz
    yaw_rad = np.arctan2(-head_m[1], -head_m[0]) + np.deg2rad(np.broadcast_to(facing_away_deg, times_s.shape))
    quats = Rotation.from_euler("z", yaw_rad[:, None]).as_quat(scalar_first=True)
    heads = np.tile(head_m, (times_s.size, 1))
    track = Track(heads, quats, heads - [0.0, 0.0, 0.7], quats)
    return Recording("standing", "made here", "motion capture", times_s, track, None, True)


def seen(recording, seed=1, **fields):
    """The observations through a sensor with these errors."""
    return [s.observation for s in observe(recording, sensor(**fields), seed)]


def position_errors(recording, seed=1, **fields):
    """Errors of the position, shape (N, 3), metres."""
    return np.array([o.head_position_base_m for o in seen(recording, seed, **fields)]) - HEAD_M


def yaw_errors(recording, part="head", seed=1, **fields):
    """Errors of a yaw, shape (N,), radians, wrapped; NaN where it is not reported."""
    true = Rotation.from_quat(recording.truth.head_quat_wxyz, scalar_first=True)
    quats = [getattr(o, f"{part}_quat_wxyz") for o in seen(recording, seed, **fields)]
    shown = Rotation.from_quat([[1.0, 0, 0, 0] if q is None else q for q in quats], scalar_first=True)
    errors = (shown * true.inv()).as_rotvec()[:, 2]
    return np.where([q is None for q in quats], np.nan, errors)


def correlation(values, lag):
    """Autocorrelation at a lag, in samples."""
    return float(np.mean(values[lag:] * values[:-lag]) / np.mean(values**2))
