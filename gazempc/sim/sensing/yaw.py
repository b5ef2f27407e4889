"""Errors of a yaw: wander, and what becomes of it while the person faces away from the sensor."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.sim.sensing.processes import held_uniform, wander
from gazempc.sim.sensing.tables import YawError
from gazempc.types import BoolArray, FloatArray


def yaw_error(
    times_s: FloatArray, away: BoolArray, error: YawError, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray]:
    """Error of a yaw, and where it is lost.

    Args:
        times_s: Times of the frames, shape (N,), seconds.
        away: Where the person faces away, shape (N,); see `faces_away`.
        error: Its size.
        rng: Source of randomness.

    Returns:
        Error, shape (N,), radians; and where there is no yaw, shape (N,).
    """
    white = np.deg2rad(error.noise_deg) * rng.standard_normal(times_s.size)
    slow = np.deg2rad(error.wander_deg) * wander(times_s, error.wander_time_s, 1, rng)[:, 0]
    fate = held_uniform(times_s, error.hold_s, rng)
    lost = away & (fate < error.lost_share)
    flipped = away & ~lost & (fate < error.lost_share + error.flipped_share)
    return white + slow + np.pi * flipped, lost | (not error.reported)


def faces_away(positions_m: FloatArray, quats_wxyz: FloatArray, away_deg: float) -> BoolArray:
    """Where a head or pelvis is turned from the origin by more than an angle, seen from above.

    Args:
        positions_m: True positions of the person, shape (N, 3), metres, base frame.
        quats_wxyz: True orientations, shape (N, 4); NaN where there is none.
        away_deg: The angle, degrees.

    Returns:
        Shape (N,); False where there is no orientation.
    """
    known = np.isfinite(quats_wxyz).all(axis=1)
    away = np.zeros(known.size, dtype=np.bool_)
    if known.any():
        forward = Rotation.from_quat(quats_wxyz[known], scalar_first=True).apply([1.0, 0.0, 0.0])[:, :2]
        to_sensor = -positions_m[known, :2]
        cross = forward[:, 0] * to_sensor[:, 1] - forward[:, 1] * to_sensor[:, 0]
        dot = np.sum(forward * to_sensor, axis=1)
        away[known] = np.abs(np.arctan2(cross, dot)) > np.deg2rad(away_deg)
    return away
