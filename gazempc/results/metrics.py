"""All metrics of a run, from its log alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import fdtri  # quantile; `scipy.stats` has it, too, and takes half a second to import

from gazempc.errors import LeftOutError
from gazempc.neck.kinematics import gaze_error_rad
from gazempc.recordings.readers.labels import travel
from gazempc.results import contact
from gazempc.results.contact import CONTACT_DEG
from gazempc.results.log import FORECAST_HORIZONS_S, Log
from gazempc.results.motion import limit_violations, motion_metrics
from gazempc.types import BoolArray, FloatArray

SCORED_FROM_S = 1.0
# Minimum duration of a run for means over the scored window.
MIN_DURATION_S = 1.25
# Minimum number of scored ticks.
_FEWEST_SCORED = 10


@dataclass(frozen=True)
class Metrics:
    """Metrics of one run; the fields are the keys of `summary.json`. NaN where the log does not determine them.

    Gaze, contact and smoothness are evaluated from 1.0 s after the first frame to the last frame; peaks and violations
    over the whole run. RMS acceleration adds all joints. The names of the forecast's metrics hold the horizon in ms.
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
    time_from_start_to_contact_s: float
    overshoot_deg: float
    rms_acceleration_rad_s2: float
    head_rms_acceleration_rad_s2: float
    eye_eccentricity_p95_deg: float
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
    false_starts_per_min: float
    time_in_zone: float
    time_to_reacquire_s: float
    reversals_per_min: float
    travel_deg_per_min: float

    def as_dict(self) -> dict[str, Any]:
        """The metrics by name."""
        return dict(vars(self))


def gaze_error_deg(log: Log) -> FloatArray:
    """Angle between the gaze and the true head at each tick.

    Args:
        log: The run.

    Returns:
        Angles, shape (M,), degrees; NaN where true head or joints are unknown.
    """
    return np.rad2deg(gaze_error_rad(log.neck.geometry, log.joint_position_rad, log.head_true_base_m))


def scored_ticks(log: Log, known: FloatArray) -> BoolArray:
    """Scored ticks: from 1.0 s on, except during gaze aversion.

    Args:
        log: The run.
        known: The scored quantity, shape (M,); NaN if unknown.

    Returns:
        Shape (M,).
    """
    scored: BoolArray = (log.time_s >= log.time_s[0] + SCORED_FROM_S - 1e-9) & np.isfinite(known)
    return scored & ~log.looks_away


_AXES = 3
# From here on the F distribution is chi-square to eleven digits; `fdtri` fails somewhere beyond 1e100.
_NORMAL_FROM = 1e12


def squared_radius(degrees_of_freedom: ArrayLike, share: float, axes: int = _AXES) -> FloatArray:
    """Squared Mahalanobis radius of the ellipsoid with a nominal coverage of the errors.

    With covariance S and error e, it bounds ``e' S^-1 e``. The errors of a forecast with nu degrees of freedom
    are assumed to have a multivariate t distribution of that covariance. Its scale matrix is ``S (nu - 2) / nu``, and
    the squared Mahalanobis distance by that matrix over d axes, divided by d, has the distribution F(d, nu). In the
    limit of infinite nu it is normal, and ``e' S^-1 e`` has the distribution chi-square(d).

    Args:
        degrees_of_freedom: Degrees of freedom of each forecast, any shape, above 2; infinite for a normal distribution.
        share: Nominal coverage, 0 to 1.
        axes: d; 2 for the ellipse seen from above.

    Returns:
        Squared radii, of the same shape.
    """
    nu = np.minimum(degrees_of_freedom, _NORMAL_FROM)
    return np.asarray(axes * fdtri(axes, nu, share) * (nu - 2.0) / nu)


def inside(nees: FloatArray, degrees_of_freedom: FloatArray, share: float) -> BoolArray:
    """Errors inside the ellipsoid of a nominal coverage, see `squared_radius`.

    Args:
        nees: Normalised squared errors ``e' S^-1 e``, shape (N,).
        degrees_of_freedom: Degrees of freedom of each forecast, shape (N,).
        share: Nominal coverage, 0 to 1.

    Returns:
        Shape (N,); False where `nees` is NaN.
    """
    return np.asarray(nees <= squared_radius(degrees_of_freedom, share))


_HALF_SECOND = 1  # of the horizons in the log
# Minimum distance of a false start: 0.6 m/s over 0.5 s, half the speed of a walk.
_FALSE_START_M = 0.3


def forecast_metrics(log: Log) -> dict[str, float]:
    """Mean error at each horizon; at 0.5 s coverage and NEES of the stated covariance and degrees of freedom.

    Args:
        log: The run.

    Returns:
        Metrics by their names in `gazempc.results.metrics.Metrics`; NaN where the log does not determine them.
    """
    difference_m = log.forecast_mean_base_m - log.forecast_true_base_m
    error_mm = 1e3 * np.linalg.norm(difference_m, axis=-1)
    found = {
        f"forecast_error_{round(1e3 * h)}_mm": contact.of_known(error_mm[:, i])
        for i, h in enumerate(FORECAST_HORIZONS_S)
    }
    known = np.isfinite(error_mm[:, _HALF_SECOND])
    covariances, differences = log.forecast_covariance_m2[known, _HALF_SECOND], difference_m[known, _HALF_SECOND]
    names = ("forecast_nees_500", "forecast_coverage_68_500", "forecast_coverage_95_500")
    if not known.any() or not np.all(np.linalg.det(covariances) > 0):
        return found | dict.fromkeys(names, float("nan"))
    nees = np.einsum("fi,fi->f", differences, np.linalg.solve(covariances, differences[..., None])[..., 0])
    held = (inside(nees, log.forecast_degrees_of_freedom[known], share) for share in (0.68, 0.95))
    return found | {name: float(np.mean(each)) for name, each in zip(names, (nees, *held), strict=True)}


def false_starts_per_min(log: Log) -> float:
    """Rate of false positive forecasts of a step, for a person who stays on the spot.

    Args:
        log: The run of a person who does not leave the spot.

    Returns:
        Episodes a minute of observations whose forecast for 0.5 s after capture is over 0.3 m, horizontally, from the
        observed position; episodes less than 0.5 s apart are one. NaN without two observations.
    """
    capture_s = np.sort(log.capture_time_s)
    if capture_s.size < 2 or capture_s[-1] == capture_s[0]:
        return float("nan")
    off_m = np.linalg.norm((log.forecast_mean_base_m[:, _HALF_SECOND] - log.head_observed_base_m)[:, :2], axis=1)
    off_s = np.sort(log.capture_time_s[off_m > _FALSE_START_M])
    episodes = off_s.size and 1 + int((np.diff(off_s) >= FORECAST_HORIZONS_S[_HALF_SECOND]).sum())
    return float(60.0 * episodes / (capture_s[-1] - capture_s[0]))


def measure(log: Log) -> Metrics:
    """Compute all metrics of a run.

    Args:
        log: The run.

    Returns:
        The metrics.

    Raises:
        LeftOutError: If the run is too short to be scored.
    """
    neck = log.neck
    error = gaze_error_deg(log)
    # Ticks are scored where true head and joints are known; in a run without a true head, where the joints are.
    knows_head = log.run.knows_true_head
    judged = error if knows_head else log.joint_position_rad.sum(axis=1)
    scored = scored_ticks(log, judged)
    if scored.sum() < _FEWEST_SCORED:
        lasts_s = log.time_s[-1] - log.time_s[0]
        why, needed = f"{lasts_s:.2f} s is too short: gaze is scored", f"{MIN_DURATION_S} s"
        if knows_head and lasts_s >= MIN_DURATION_S:
            why, needed = f"true head and joints are known at {scored.sum()} ticks", str(_FEWEST_SCORED)
        raise LeftOutError(f"{log.run.recording}: {why} from {SCORED_FROM_S} s on, at least {needed} are needed")
    # At a few frames a second the true head is known at single ticks only: no durations.
    lasting = knows_head and float(np.median(np.diff(np.flatnonzero(scored)))) == 1.0
    reached = error <= CONTACT_DEG[0]
    moved = travel(log.time_s, log.head_true_base_m)
    error_scored = error[scored]
    return Metrics(
        gaze_error_rms_deg=float(np.sqrt(np.mean(error_scored**2))),
        gaze_error_median_deg=float(np.median(error_scored)),
        gaze_error_p95_deg=float(np.percentile(error_scored, 95)),
        eye_contact_2p6=contact.share_within(error_scored, CONTACT_DEG[0]),
        eye_contact_4=contact.share_within(error_scored, CONTACT_DEG[1]),
        eye_contact_9=contact.share_within(error_scored, CONTACT_DEG[2]),
        longest_break_s=contact.longest_break_s(log, error, scored) if lasting else float("nan"),
        time_to_contact_s=contact.time_to(reached, log.time_s),
        time_to_stable_contact_s=(
            contact.time_to_stable(reached, log.time_s, neck.servo_period_s) if lasting else float("nan")
        ),
        time_from_start_to_contact_s=(
            contact.time_from_start_to_contact(log, error, moved.start_s) if lasting else float("nan")
        ),
        overshoot_deg=contact.overshoot_deg(log),
        limit_violations=limit_violations(log, neck),
        **motion_metrics(log, scored),
        **contact.framing_metrics(log, scored),
        **forecast_metrics(log),
        false_starts_per_min=false_starts_per_min(log) if knows_head and not moved.leaves else float("nan"),
    )


def gap_closed(rms_deg: float, reactive_rms_deg: float, perfect_rms_deg: float) -> float:
    """Share of the gap between reactive control and the true future that is closed.

    Args:
        rms_deg: RMS gaze error of the controller in question, degrees.
        reactive_rms_deg: RMS error of the reactive gaze.
        perfect_rms_deg: RMS error of the MPC with the true future.

    Returns:
        1 at the limit of the neck, 0 for reactive control; NaN unless the second reference is better than the first.
    """
    gap = reactive_rms_deg - perfect_rms_deg
    return (reactive_rms_deg - rms_deg) / gap if gap > 0 else float("nan")
