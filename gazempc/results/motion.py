"""Motion of the joints: peaks, smoothness and limit violations, at the times of the readings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from gazempc.neck.kinematics import gaze_ray, head_angles_rad
from gazempc.neck.spec import EYE_AXES, NeckSpec
from gazempc.results.contact import of_known, p95
from gazempc.results.log import Log
from gazempc.types import BoolArray, FloatArray, IntArray

# Parameters of the authors: cut-off frequency; amplitude threshold as a share of the peak; zero padding, in powers of
# two beyond the length.
_CUTOFF_HZ, _THRESHOLD, _PADDING = 10.0, 0.05, 4


def sparc(speed: FloatArray, rate_hz: float) -> float:
    """Spectral arc length of a speed profile; larger (less negative) is smoother.

    Balasubramanian, Melendez-Calderon, Roby-Brami & Burdet (2015), On the analysis of movement smoothness, eq. 9,
    with their parameters.

    Args:
        speed: Speed over time, shape (M,), any unit.
        rate_hz: Samples a second.

    Returns:
        The arc length, negative; NaN if nothing moves.
    """
    points = 2 ** int(np.ceil(np.log2(speed.size)) + _PADDING)
    spectrum = np.abs(np.fft.fft(speed, points))
    if spectrum.max() == 0.0:
        return float("nan")
    frequency_hz = np.arange(points) * rate_hz / points
    amplitude = spectrum / spectrum.max()
    above = np.flatnonzero((amplitude >= _THRESHOLD) & (frequency_hz <= _CUTOFF_HZ))
    if above.size < 2:
        return float("nan")
    used = np.arange(above[0], above[-1] + 1)
    across = np.diff(frequency_hz[used]) / np.ptp(frequency_hz[used])
    return -float(np.sum(np.hypot(across, np.diff(amplitude[used]))))


def log_dimensionless_jerk(speed: FloatArray, rate_hz: float) -> float:
    """Log dimensionless jerk of a speed profile; larger (less negative) is smoother.

    Balasubramanian et al. (2015), eq. 6: ``-ln(duration^3 / peak speed^2 * integral of (d2 speed / dt2)^2)``.

    Args:
        speed: Speed over time, shape (M,), any unit.
        rate_hz: Samples a second.

    Returns:
        The index; NaN if nothing moves or the speed has no curvature.
    """
    dt_s = 1.0 / rate_hz
    jerk = np.diff(speed, 2) / dt_s**2
    scale = (speed.size * dt_s) ** 3 / speed.max() ** 2 if speed.size and speed.max() > 0 else np.nan
    total = scale * np.sum(jerk**2) * dt_s
    return -float(np.log(total)) if total > 0 else float("nan")


# Minimum amplitude of a reversal.
SWING_DEG = 0.5


def reversals(angle_deg: FloatArray) -> int:
    """Number of reversals of a joint, with an amplitude of at least 0.5 degrees before and after.

    Args:
        angle_deg: The joint's angle over time, shape (N,), degrees.

    Returns:
        Number of reversals.
    """
    count, way = 0, 0
    low = high = float(angle_deg[0])
    for angle in angle_deg.tolist():
        low, high = min(low, angle), max(high, angle)
        if way >= 0 and angle <= high - SWING_DEG:
            count += way > 0
            way, low = -1, angle
        elif way <= 0 and angle >= low + SWING_DEG:
            count += way < 0
            way, high = 1, angle
    return count


# Minimum interval of readings, in servo periods: shorter ones amplify encoder noise in derivatives.
_NEAREST_PERIODS = 0.5
# Minimum number of readings, for a third difference.
_FEWEST = 4


@dataclass(frozen=True)
class Readings:
    """New joint readings of a log.

    Attributes:
        tick: Ticks of their arrival, shape (K,).
        time_s: Measurement times, increasing, shape (K,), seconds.
        position_rad: Angles of all joints, shape (K, N), radians.
    """

    tick: IntArray
    time_s: FloatArray
    position_rad: FloatArray


def readings(log: Log) -> Readings:
    """The new joint readings; only the first of those within half a servo period.

    Args:
        log: The run.

    Returns:
        The readings; empty without joint feedback.
    """
    known = np.flatnonzero(np.isfinite(log.joint_time_s) & np.isfinite(log.joint_position_rad).all(axis=1))
    nearest_s = _NEAREST_PERIODS * log.neck.servo_period_s
    tick = known[list(_apart(log.joint_time_s[known].tolist(), nearest_s))]
    return Readings(tick, log.joint_time_s[tick], log.joint_position_rad[tick])


def derivative(values: FloatArray, time_s: FloatArray, order: int) -> FloatArray:
    """Finite-difference derivatives at irregular times.

    By the mean value theorem each equals the derivative at a time between the first and the last of its ``order + 1``
    values. So their maximum never exceeds that of the motion.

    Args:
        values: Shape (K, N).
        time_s: Increasing, shape (K,), seconds.
        order: 1, 2, ...

    Returns:
        Shape (K - order, N), per second to that power.
    """
    for k in range(1, order + 1):
        values = k * np.diff(values, axis=0) / (time_s[k:] - time_s[:-k])[:, None]
    return values


def motion_metrics(log: Log, scored: BoolArray) -> dict[str, float]:
    """Smoothness and peaks of joints, head and gaze, and eccentricity of the eyes.

    Args:
        log: The run.
        scored: Ticks of the scored window, shape (M,).

    Returns:
        Metrics by their names in `gazempc.results.metrics.Metrics`; NaN where the log does not determine them.
    """
    neck, read = log.neck, readings(log)
    enough = read.tick.size >= _FEWEST
    found = {
        name: float(np.max(np.abs(derivative(read.position_rad, read.time_s, order)))) if enough else np.nan
        for order, name in enumerate(("peak_velocity_rad_s", "peak_acceleration_rad_s2", "peak_jerk_rad_s3"), start=1)
    }
    counts, head_rad = scored[read.tick], head_angles_rad(read.position_rad)
    speed = _gaze_speed(neck, read, counts) if enough else np.empty(0)
    long_enough = speed.size >= _FEWEST
    head_deg = np.rad2deg(head_rad[counts])
    minutes = float(np.ptp(read.time_s[counts])) / 60.0 if head_deg.size else 0.0
    return found | {
        "rms_acceleration_rad_s2": _rms_acceleration(read.position_rad, read.time_s, counts),
        "head_rms_acceleration_rad_s2": _rms_acceleration(head_rad, read.time_s, counts),
        "sparc": sparc(speed, neck.servo_rate_hz) if long_enough else np.nan,
        "ldlj": log_dimensionless_jerk(speed, neck.servo_rate_hz) if long_enough else np.nan,
        "reversals_per_min": sum(map(reversals, head_deg.T)) / minutes if minutes else np.nan,
        "travel_deg_per_min": float(np.abs(np.diff(head_deg, axis=0)).sum()) / minutes if minutes else np.nan,
        "eye_eccentricity_p95_deg": of_known(eye_eccentricity_deg(log)[scored], p95),
    }


def eye_eccentricity_deg(log: Log) -> FloatArray:
    """Angle between the gaze and the direction of the head.

    Args:
        log: The run.

    Returns:
        Angles, shape (M,), degrees; NaN for a neck without eyes, and without joint readings.
    """
    if log.neck.eyes is None:
        return np.full(log.time_s.size, np.nan)
    pan, tilt = (log.joint_position_rad[:, log.neck.joint_names.index(name)] for name in EYE_AXES)
    return np.asarray(np.rad2deg(np.arccos(np.clip(np.cos(pan) * np.cos(tilt), -1.0, 1.0))))


def _apart(times_s: list[float], nearest_s: float) -> Iterator[int]:
    last_s = -np.inf
    for index, time_s in enumerate(times_s):
        if time_s - last_s >= nearest_s:
            last_s = time_s
            yield index


def _rms_acceleration(position_rad: FloatArray, time_s: FloatArray, counts: BoolArray) -> float:
    acceleration = derivative(position_rad, time_s, 2)[counts[2:]] if time_s.size > 2 else position_rad[:0]
    return float(np.sqrt(np.mean(np.sum(acceleration**2, axis=1)))) if acceleration.size else float("nan")


def _gaze_speed(neck: NeckSpec, read: Readings, counts: BoolArray) -> FloatArray:
    """Speed of the gaze direction from the first to the last scored reading, resampled uniformly, shape (S,), 1/s."""
    within_s = read.time_s[counts]
    if within_s.size < _FEWEST:
        return np.empty(0)
    period_s = neck.servo_period_s
    even_s = within_s[0] + period_s * np.arange(int((within_s[-1] - within_s[0]) / period_s + 1e-6) + 1)
    angles_rad = CubicSpline(read.time_s, read.position_rad)(even_s)
    _, direction = gaze_ray(neck.geometry, angles_rad)
    return np.asarray(np.linalg.norm(np.diff(direction, axis=0), axis=1) / period_s)


# Tolerance for quantisation of commands by a robot; the coarsest known one is 0.0015 rad (Dynamixel: 4096 a turn).
_ROBOT_STEP_RAD = 0.004
# Third differences of double-precision angles at 200 Hz carry about 1e-8 of rounding.
_TOLERANCE = 1e-6


def limit_violations(log: Log, neck: NeckSpec) -> int:
    """Count ticks and joints at which command or joint is outside the neck's limits.

    In a replay: positions of commands and joints, and their finite differences. In a live run: the commands sent, and
    the planned velocity, acceleration and jerk.

    Args:
        log: The run.
        neck: The limits.

    Returns:
        The number of violations.
    """
    dt_s, command_rad, count = neck.servo_period_s, log.command_position_rad, 0
    limits = (neck.velocity_max_rad_s, neck.acceleration_max_rad_s2, neck.jerk_max_rad_s3)
    if log.run.joints == "measured":
        # Readings are irregular, and a robot may quantise commands: the planned motion is checked.
        positions = [command_rad]
        jerk = np.diff(log.command_acceleration_rad_s2, axis=0) / dt_s
        planned = (log.command_velocity_rad_s, log.command_acceleration_rad_s2, jerk)
        motions = list(zip(planned, limits, strict=True))
        # A robot may approach its first command at its own speed, but commands must not jump.
        step_rad = neck.velocity_max_rad_s * dt_s + _ROBOT_STEP_RAD
        count = int(np.sum(np.abs(np.diff(command_rad, axis=0)) > step_rad))
    else:
        positions = [command_rad, log.joint_position_rad]
        orders = list(enumerate(limits, start=1))
        motions = [(np.diff(q, order, axis=0) / dt_s**order, limit) for q in positions for order, limit in orders]
    outside = [(q > neck.position_max_rad + _TOLERANCE) | (q < neck.position_min_rad - _TOLERANCE) for q in positions]
    beyond = [np.abs(motion) > limit * (1.0 + _TOLERANCE) for motion, limit in motions]
    return count + sum(int(np.sum(each)) for each in (*outside, *beyond))
