"""Error and calibration of the forecasts in a log."""

from __future__ import annotations

import numpy as np

from gazempc.results.log import Log
from gazempc.types import FloatArray

# Quantiles of chi-square with 3 degrees of freedom: the stated 68 and 95 % ellipsoids. As numbers, because
# `scipy.stats` takes half a second to import; a test compares them with it.
INSIDE_68, INSIDE_95 = 3.5058823558, 7.8147279033


def forecast_metrics(log: Log) -> dict[str, float]:
    """Mean error at each horizon; at 0.5 s coverage and NEES of the stated covariance.

    Args:
        log: The run.

    Returns:
        Metrics by their names in `gazempc.results.metrics.Metrics`; NaN where the log cannot tell.
    """
    difference_m = log.forecast_mean_base_m - log.forecast_true_base_m
    error_mm = 1e3 * np.linalg.norm(difference_m, axis=-1)
    found = {
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
    found["forecast_coverage_68_500"] = float(np.mean(nees <= INSIDE_68)) if certain else float("nan")
    found["forecast_coverage_95_500"] = float(np.mean(nees <= INSIDE_95)) if certain else float("nan")
    found["forecast_nees_500"] = float(np.mean(nees)) if certain else float("nan")
    return found


def _mean_of_known(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if known.size else float("nan")
