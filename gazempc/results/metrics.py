"""All figures of a run, from its log alone."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gazempc.errors import LeftOutError
from gazempc.neck.kinematics import gaze_error_rad, gaze_ray, look_at
from gazempc.neck.spec import NeckSpec
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.smoothness import log_dimensionless_jerk, sparc
from gazempc.types import FloatArray

SCORED_FROM_S = 1.0
# With less than this, a mean over the scored window would be one glance.
MIN_DURATION_S = 1.25
_FEWEST_SCORED = 10
# Contact that lasts at least this long is called stable.
STABLE_S = 0.5
# The pan joint overshoots within this time after it first comes into contact, or not at all.
OVERSHOOT_S = 1.0
# Half width of the cone in which people feel looked at: 5.2 deg diameter, Horstmann & Linke (2021); other
# authors' wider cones beside it.
CONTACT_DEG = (2.6, 4.0, 9.0)
# Third differences of double-precision angles at 200 Hz carry about 1e-8 of rounding.
_ROBOT_STEP_RAD = 0.004
_LIMIT_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Metrics:
    """Figures of one run; the fields are the keys of `summary.json`. NaN where the log cannot tell.

    Gaze, contact and smoothness are taken from 1.0 s after the first frame to the last frame; peaks and violations
    over the whole run. RMS acceleration adds both joints. Forecast figures follow the horizon in ms.
    """

    gaze_error_rms_deg: float
    gaze_error_median_deg: float
    gaze_error_p95_deg: float
    eye_contact_2p6: float
    eye_contact_4: float
    eye_contact_9: float
    longest_break_s: float
    time_to_contact_s: float
    time_to_stable_contact_s: float
    overshoot_deg: float
    rms_acceleration_rad_s2: float
    peak_velocity_rad_s: float
    peak_acceleration_rad_s2: float
    peak_jerk_rad_s3: float
    limit_violations: int
    sparc: float
    ldlj: float
    forecast_error_250_mm: float
    forecast_error_500_mm: float
    forecast_error_1000_mm: float
    forecast_coverage_68_500: float
    forecast_coverage_95_500: float
    forecast_nees_500: float

    def as_dict(self) -> dict[str, Any]:
        """The figures by name."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


@dataclass(frozen=True)
class ComputeMetrics:
    """How long the computer took; these differ from run to run.

    Attributes:
        update_ms_p50: Median predictor update, milliseconds.
        update_ms_p99: 99th percentile.
        update_ms_max: Longest.
        step_ms_p50: Median controller step (forecast and plan), milliseconds.
        step_ms_p99: 99th percentile.
        step_ms_max: Longest.
        missed_deadlines: Steps that took longer than a control period.
    """

    update_ms_p50: float
    update_ms_p99: float
    update_ms_max: float
    step_ms_p50: float
    step_ms_p99: float
    step_ms_max: float
    missed_deadlines: int

    def as_dict(self) -> dict[str, Any]:
        """The figures by name."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


def gaze_error_deg(log: Log) -> FloatArray:
    """Angle between the gaze and the true head at each tick.

    Args:
        log: The run.

    Returns:
        Angles, shape (M,), degrees; NaN where true head or joints are not known.
    """
    error = gaze_error_rad(log.neck.geometry, log.joint_position_rad, log.head_true_base_m)
    return np.rad2deg(error)


def measure(log: Log) -> Metrics:
    """Compute all figures of a run.

    Args:
        log: The run.

    Returns:
        The figures.

    Raises:
        LeftOutError: If the run is too short to be scored.
    """
    neck = log.neck
    error = gaze_error_deg(log)
    # Nothing is scored where the true head or the joints are not known. Live nobody knows the true head; what needs no
    # head is scored still.
    knows_head = log.run.knows_true_head
    judged = error if knows_head else log.joint_position_rad.sum(axis=1)
    scored = (log.time_s >= log.time_s[0] + SCORED_FROM_S - 1e-9) & np.isfinite(judged)
    if scored.sum() < _FEWEST_SCORED:
        raise LeftOutError(
            f"{log.run.recording}: {log.time_s[-1] - log.time_s[0]:.2f} s is too short: gaze is "
            f"scored from {SCORED_FROM_S} s to the end, and at least {MIN_DURATION_S} s are needed"
        )
    # The ticks of a live run come a little early or late; the motion was made for equal ones.
    dt_s = neck.servo_period_s
    acceleration = np.diff(log.joint_position_rad, 2, axis=0) / dt_s**2
    scored_acceleration = acceleration[scored[2:]]
    error_scored = error[scored]
    _, direction = gaze_ray(neck.geometry, log.joint_position_rad[scored])
    speed = np.linalg.norm(np.diff(direction, axis=0), axis=1) / dt_s
    return Metrics(
        gaze_error_rms_deg=float(np.sqrt(np.mean(error_scored**2))),
        gaze_error_median_deg=float(np.median(error_scored)),
        gaze_error_p95_deg=float(np.percentile(error_scored, 95)),
        eye_contact_2p6=_share_within(error_scored, CONTACT_DEG[0]),
        eye_contact_4=_share_within(error_scored, CONTACT_DEG[1]),
        eye_contact_9=_share_within(error_scored, CONTACT_DEG[2]),
        longest_break_s=_longest_run(error_scored > CONTACT_DEG[0]) * dt_s if knows_head else float("nan"),
        time_to_contact_s=_first(error <= CONTACT_DEG[0], log.time_s),
        time_to_stable_contact_s=_first(_lasting(error <= CONTACT_DEG[0], round(STABLE_S / dt_s)), log.time_s),
        overshoot_deg=_overshoot_deg(log, neck),
        rms_acceleration_rad_s2=float(np.sqrt(np.nanmean(np.sum(scored_acceleration**2, axis=1)))),
        peak_velocity_rad_s=_peak(log.joint_position_rad, 1, dt_s),
        peak_acceleration_rad_s2=_peak(log.joint_position_rad, 2, dt_s),
        peak_jerk_rad_s3=_peak(log.joint_position_rad, 3, dt_s),
        limit_violations=limit_violations(log, neck),
        sparc=sparc(speed, 1.0 / dt_s),
        ldlj=log_dimensionless_jerk(speed, 1.0 / dt_s),
        **_forecast_metrics(log),
    )


def measure_compute(times: ComputeTimes, control_period_s: float) -> ComputeMetrics:
    """Summarise compute times.

    Args:
        times: What the loop measured.
        control_period_s: Deadline of a step, seconds.

    Returns:
        The figures; NaN where nothing was measured.
    """

    def percentile(values: FloatArray, q: float) -> float:
        return float(np.percentile(values, q)) if values.size else float("nan")

    return ComputeMetrics(
        update_ms_p50=percentile(times.update_ms, 50),
        update_ms_p99=percentile(times.update_ms, 99),
        update_ms_max=percentile(times.update_ms, 100),
        step_ms_p50=percentile(times.step_ms, 50),
        step_ms_p99=percentile(times.step_ms, 99),
        step_ms_max=percentile(times.step_ms, 100),
        missed_deadlines=int(np.sum(times.step_ms > 1e3 * control_period_s)),
    )


def gap_closed(rms_deg: float, reactive_rms_deg: float, perfect_rms_deg: float) -> float:
    """Share of the way from the reactive gaze to perfect foresight.

    Args:
        rms_deg: RMS gaze error of the controller in question, degrees.
        reactive_rms_deg: That of the reactive gaze.
        perfect_rms_deg: That of the MPC with the true future.

    Returns:
        1 at the limit of the neck, 0 where the reactive gaze is; NaN if these two do not differ.
    """
    gap = reactive_rms_deg - perfect_rms_deg
    return (reactive_rms_deg - rms_deg) / gap if gap > 0 else float("nan")


def limit_violations(log: Log, neck: NeckSpec) -> int:
    """Count ticks and joints at which command or joint is outside the neck's limits.

    Position, velocity, acceleration and jerk are those of the positions in the log, by differences; both the
    command's and the joint's count. In a live run the position that was sent counts, and the motion of the command.

    Args:
        log: The run.
        neck: The limits.

    Returns:
        The number of violations.
    """
    dt_s = neck.servo_period_s
    count = 0
    if log.run.joints == "measured":
        # Readings of a robot come when they come, and it may round commands to steps of its own: what was meant counts.
        return _violations_of_motion(log, neck)
    for position in (log.command_position_rad, log.joint_position_rad):
        count += int(np.sum(position > neck.position_max_rad + _LIMIT_TOLERANCE))
        count += int(np.sum(position < neck.position_min_rad - _LIMIT_TOLERANCE))
        limits = (neck.velocity_max_rad_s, neck.acceleration_max_rad_s2, neck.jerk_max_rad_s3)
        for order, limit in enumerate(limits, start=1):
            motion = np.abs(np.diff(position, order, axis=0)) / dt_s**order
            count += int(np.sum(motion > limit * (1.0 + _LIMIT_TOLERANCE)))
    return count


def _violations_of_motion(log: Log, neck: NeckSpec) -> int:
    position = log.command_position_rad
    count = int(np.sum(position > neck.position_max_rad + _LIMIT_TOLERANCE))
    count += int(np.sum(position < neck.position_min_rad - _LIMIT_TOLERANCE))
    # A robot may round to steps of its own, and reach its first command at a speed of its own; a jump it must not get.
    step_rad = neck.velocity_max_rad_s * neck.servo_period_s + _ROBOT_STEP_RAD
    count += int(np.sum(np.abs(np.diff(position, axis=0)) > step_rad))
    jerk = np.diff(log.command_acceleration_rad_s2, axis=0) / neck.servo_period_s
    for motion, limit in (
        (log.command_velocity_rad_s, neck.velocity_max_rad_s),
        (log.command_acceleration_rad_s2, neck.acceleration_max_rad_s2),
        (jerk, neck.jerk_max_rad_s3),
    ):
        count += int(np.sum(np.abs(motion) > limit * (1.0 + _LIMIT_TOLERANCE)))
    return count


def _forecast_metrics(log: Log) -> dict[str, float]:
    difference_m = log.forecast_mean_base_m - log.forecast_true_base_m
    error_mm = 1e3 * np.linalg.norm(difference_m, axis=-1)
    figures = {
        f"forecast_error_{round(1e3 * h)}_mm": _mean_of_known(error_mm[:, i])
        for i, h in enumerate(log.forecast_horizon_s)
    }
    half_second = 1
    known = np.isfinite(error_mm[:, half_second])
    covariances = log.forecast_covariance_m2[known, half_second]
    differences = difference_m[known, half_second]
    nees = np.full(len(differences), np.nan)
    if len(differences) and np.all(np.linalg.det(covariances) > 0):
        nees = np.einsum("fi,fi->f", differences, np.linalg.solve(covariances, differences[..., None])[..., 0])
    certain = np.isfinite(nees).all() and nees.size > 0
    # 68 and 95 % quantiles of chi-square with 3 degrees of freedom.
    figures["forecast_coverage_68_500"] = float(np.mean(nees <= 3.5058823558)) if certain else float("nan")
    figures["forecast_coverage_95_500"] = float(np.mean(nees <= 7.8147279033)) if certain else float("nan")
    figures["forecast_nees_500"] = float(np.mean(nees)) if certain else float("nan")
    return figures


def _share_within(error_deg: FloatArray, limit_deg: float) -> float:
    return float(np.mean(error_deg <= limit_deg)) if np.isfinite(error_deg).all() else float("nan")


def _mean_of_known(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if known.size else float("nan")


def _peak(position_rad: FloatArray, order: int, dt_s: float) -> float:
    return float(np.nanmax(np.abs(np.diff(position_rad, order, axis=0)))) / dt_s**order


def _longest_run(flags: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return int(np.max(edges[1::2] - edges[::2])) if edges.size else 0


def _lasting(flags: NDArray[np.bool_], ticks: int) -> NDArray[np.bool_]:
    """Ticks from which on a flag is true for so many ticks."""
    run = np.convolve(flags, np.ones(ticks), "valid") == ticks
    return np.concatenate([run, np.zeros(flags.size - run.size, dtype=np.bool_)])


def _overshoot_deg(log: Log, neck: NeckSpec) -> float:
    pan_rad = look_at(neck.geometry, log.head_true_base_m).angles_rad[:, 0]
    off_deg = np.rad2deg((log.joint_position_rad[:, 0] - pan_rad + np.pi) % (2.0 * np.pi) - np.pi)
    if not abs(off_deg[0]) > CONTACT_DEG[-1]:
        return float("nan")
    passed_deg = -np.sign(off_deg[0]) * off_deg
    there = np.flatnonzero(passed_deg >= -CONTACT_DEG[0])
    if not there.size:
        return float("nan")
    soon = log.time_s <= log.time_s[there[0]] + OVERSHOOT_S
    return max(0.0, float(np.nanmax(passed_deg[there[0] :][soon[there[0] :]])))


def _first(flags: NDArray[np.bool_], time_s: FloatArray) -> float:
    hits = np.flatnonzero(flags)
    return float(time_s[hits[0]] - time_s[0]) if hits.size else float("nan")
