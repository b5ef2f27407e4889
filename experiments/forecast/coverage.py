"""Which errors lie inside what a forecast states to hold a share of them."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2, f

from gazempc.types import BoolArray, FloatArray

_AXES = 3


def inside(nees: FloatArray, degrees_of_freedom: FloatArray, share: float) -> BoolArray:
    """Errors inside the ellipsoid that should hold a share of them.

    With S the covariance and e the error, ``nees = e' S^-1 e``. The errors of a forecast with nu degrees of freedom are
    said to have a multivariate t distribution of that covariance. Its scale matrix is ``S (nu - 2) / nu``, and the
    squared distance by that matrix over 3 has the distribution F(3, nu). Without end of nu it is the normal one, and
    `nees` has the distribution chi-square(3).

    Args:
        nees: Normalised squared errors, shape (N,).
        degrees_of_freedom: Those of each forecast, shape (N,), above 2; infinite for a normal distribution.
        share: The share that should be inside, 0 to 1.

    Returns:
        Shape (N,); False where `nees` is NaN.
    """
    limit = np.full(np.shape(nees), float(chi2.ppf(share, df=_AXES)))
    tailed = np.isfinite(degrees_of_freedom)
    nu = np.asarray(degrees_of_freedom)[tailed]
    limit[tailed] = _AXES * f.ppf(share, _AXES, nu) * (nu - 2.0) / nu
    return np.asarray(nees <= limit)
