"""Error and calibration of the forecasts in a log."""

from __future__ import annotations

import numpy as np

from gazempc.results.coverage import inside
from gazempc.results.log import Log
from gazempc.types import FloatArray


def forecast_metrics(log: Log) -> dict[str, float]:
    """Mean error at each horizon; at 0.5 s coverage and NEES of what is stated: covariance and degrees of freedom.

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
    freedom = log.forecast_degrees_of_freedom[known]
    for percent in (68, 95):
        held = float(np.mean(inside(nees, freedom, percent / 100))) if certain else float("nan")
        found[f"forecast_coverage_{percent}_500"] = held
    found["forecast_nees_500"] = float(np.mean(nees)) if certain else float("nan")
    return found


def _mean_of_known(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if known.size else float("nan")
