"""Error and calibration of the forecasts in a log."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import fdtri  # quantile; `scipy.stats` has it, too, and takes half a second to import

from gazempc.results.contact import of_known
from gazempc.results.log import FORECAST_HORIZONS_S, Log
from gazempc.types import BoolArray, FloatArray

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
    found = {f"forecast_error_{round(1e3 * h)}_mm": of_known(error_mm[:, i]) for i, h in enumerate(FORECAST_HORIZONS_S)}
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
