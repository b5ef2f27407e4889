"""Errors of position and yaw, and the covariance stated by a sensor."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.sim.sensing.processes import bouts, held_uniform, wander
from gazempc.sim.sensing.tables import AcrossError, AlongError, Jumps, OtherPerson, YawError
from gazempc.types import BoolArray, FloatArray

# Above or below the sensor "left" is undefined; any horizontal direction is valid.
_VERTICAL = 1e-9


def sight_axes(positions_m: FloatArray) -> FloatArray:
    """Frames of the lines of sight from the origin: along, left, up.

    Args:
        positions_m: Shape (N, 3), metres.

    Returns:
        Shape (N, 3, 3), a unit vector a row.
    """
    range_m = np.linalg.norm(positions_m, axis=1, keepdims=True)
    along = np.divide(positions_m, range_m, out=np.tile([1.0, 0.0, 0.0], (len(positions_m), 1)), where=range_m > 0)
    level = np.hypot(along[:, 0], along[:, 1])[:, None]
    flat_left = np.stack([-along[:, 1], along[:, 0], np.zeros(len(along))], axis=1)
    left = np.where(level > _VERTICAL, flat_left / np.maximum(level, _VERTICAL), [0.0, 1.0, 0.0])
    return np.stack([along, left, np.cross(along, left)], axis=1)


def sight_sds(positions_m: FloatArray, along: AlongError, across: AcrossError) -> tuple[FloatArray, FloatArray]:
    """Standard deviations of white error and wander on the axes of `sight_axes`.

    Args:
        positions_m: Shape (N, 3), metres.
        along: Error of the range.
        across: Error across the line of sight.

    Returns:
        White error and wander, each of shape (N, 3), metres.
    """
    range_m = np.linalg.norm(positions_m, axis=1)
    white, slow = np.stack([error.sds_m(range_m) for error in (along, across, across)], axis=-1)
    return white, slow


def sight_error(
    times_s: FloatArray, positions_m: FloatArray, along: AlongError, across: AcrossError, rng: np.random.Generator
) -> FloatArray:
    """White error and wander along and across the line of sight.

    Args:
        times_s: Times of the frames, shape (N,), seconds.
        positions_m: True positions, shape (N, 3), metres, base frame; NaN while absent.
        along: Error of the range.
        across: Error across the line of sight.
        rng: Random generator.

    Returns:
        Error in the base frame, shape (N, 3), metres.
    """
    white, slow = sight_sds(positions_m, along, across)
    steps = [wander(times_s, along.wander_time_s, 1, rng), wander(times_s, across.wander_time_s, 2, rng)]
    on_axes = white * rng.standard_normal((times_s.size, 3)) + slow * np.concatenate(steps, axis=1)
    return np.asarray(np.einsum("na,nai->ni", on_axes, sight_axes(positions_m)))


def jump_error(times_s: FloatArray, jumps: Jumps, rng: np.random.Generator) -> FloatArray:
    """Jumps of the track.

    Args:
        times_s: Times of the frames, shape (N,), seconds.
        jumps: Frequency, duration and size.
        rng: Random generator.

    Returns:
        Error in the base frame, shape (N, 3), metres; 0 outside jumps.
    """
    number = bouts(times_s, jumps, rng)
    count = int(number.max()) + 1
    aside = rng.standard_normal((count, 3)) * ([1.0, 1.0, 0.0] if jumps.level else [1.0, 1.0, 1.0])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    aside *= rng.uniform(jumps.size_min_m, jumps.size_max_m, count)[:, None]
    error = np.zeros((times_s.size, 3))
    error[number >= 0] = aside[number[number >= 0]]
    return error


def shows_other(times_s: FloatArray, other: OtherPerson) -> BoolArray:
    """Mask of the frames that show the other person: at the end of each period, counted from the first frame.

    Args:
        times_s: Times of the frames, shape (N,), seconds.
        other: Period and duration.

    Returns:
        Shape (N,).
    """
    if not other.is_there:
        return np.zeros(times_s.size, dtype=np.bool_)
    # Tolerance for frames at the boundary of a period.
    in_period_s = (times_s - times_s[0] + 1e-6) % other.every_s
    return np.asarray(in_period_s >= other.every_s - other.shown_s)


def other_offset(positions_m: FloatArray, shown: BoolArray, other: OtherPerson) -> FloatArray:
    """Displacement from the first person to the other one, at the frames that show the other.

    Args:
        positions_m: True positions of the first person, shape (N, 3), metres, base frame; NaN while absent.
        shown: Mask of the frames that show the other person, shape (N,).
        other: Distance between the people.

    Returns:
        Shape (N, 3), metres; 0 at the other frames.
    """
    offset = np.zeros_like(positions_m)
    if shown.any():
        offset[shown] = other.aside_m * sight_axes(positions_m[shown])[:, 1]
    return offset


def stated_covariances(
    measured_m: FloatArray, each_axis_m: float, along: AlongError, across: AcrossError
) -> FloatArray:
    """Error covariance stated by a sensor: white error plus wander, at the measured range.

    Args:
        measured_m: Measured positions, shape (N, 3), metres, base frame.
        each_axis_m: Standard deviation of the isotropic error, metres.
        along: Error of the range.
        across: Error across the line of sight.

    Returns:
        Shape (N, 3, 3), square metres, base frame.
    """
    white, slow = sight_sds(measured_m, along, across)
    variances = white**2 + slow**2 + each_axis_m**2
    axes = sight_axes(measured_m)
    return np.asarray(np.einsum("nai,na,naj->nij", axes, variances, axes))


def yaw_error(
    times_s: FloatArray, away: BoolArray, error: YawError, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray]:
    """Error and loss of a yaw.

    Args:
        times_s: Times of the frames, shape (N,), seconds.
        away: Mask of the frames in which the person faces away, shape (N,); see `faces_away`.
        error: Parameters of the error.
        rng: Random generator.

    Returns:
        Error, shape (N,), radians; mask of the frames without a yaw, shape (N,).
    """
    white = np.deg2rad(error.noise_deg) * rng.standard_normal(times_s.size)
    slow = np.deg2rad(error.wander_deg) * wander(times_s, error.wander_time_s, 1, rng)[:, 0]
    fate = held_uniform(times_s, error.hold_s, rng)
    lost = away & (fate < error.lost_share)
    flipped = away & ~lost & (fate < error.lost_share + error.flipped_share)
    return white + slow + np.pi * flipped, lost | (not error.reported)


def faces_away(positions_m: FloatArray, quats_wxyz: FloatArray, away_deg: float) -> BoolArray:
    """Mask of the frames in which a head or pelvis is turned from the origin by more than an angle, about the vertical.

    Args:
        positions_m: True positions of the person, shape (N, 3), metres, base frame.
        quats_wxyz: True orientations, shape (N, 4); NaN if unknown.
        away_deg: The angle, degrees.

    Returns:
        Shape (N,); False if the orientation is unknown.
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
