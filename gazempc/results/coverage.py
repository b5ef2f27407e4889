"""Which errors lie inside what a forecast states to hold a share of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, fdtri  # quantiles; `scipy.stats` has them, too, and takes half a second to import

from gazempc.types import BoolArray, FloatArray

_AXES = 3
# From here on the two distributions agree to nine digits, and `fdtri` fails somewhere beyond 1e100.
_NORMAL_FROM = 1e12


def squared_radius(degrees_of_freedom: ArrayLike, share: float, axes: int = _AXES) -> FloatArray:
    """Squared radius, in units of the covariance, of the ellipsoid that should hold a share of the errors.

    With S the covariance and e the error, it is a limit of ``e' S^-1 e``. The errors of a forecast with nu degrees of
    freedom are said to have a multivariate t distribution of that covariance. Its scale matrix is ``S (nu - 2) / nu``,
    and the squared distance by that matrix over d axes has, divided by d, the distribution F(d, nu). Without end of nu
    it is the normal one, and ``e' S^-1 e`` has the distribution chi-square(d).

    Args:
        degrees_of_freedom: Those of each forecast, any shape, above 2; infinite for a normal distribution.
        share: The share that should be inside, 0 to 1.
        axes: d; 2 for the ellipse seen from above.

    Returns:
        Of the same shape.
    """
    nu = np.asarray(degrees_of_freedom, dtype=np.float64)
    radius = np.full(nu.shape, float(chdtri(axes, 1.0 - share)))
    tailed = nu < _NORMAL_FROM
    radius[tailed] = axes * fdtri(axes, nu[tailed], share) * (nu[tailed] - 2.0) / nu[tailed]
    return radius


def inside(nees: FloatArray, degrees_of_freedom: FloatArray, share: float) -> BoolArray:
    """Errors inside the ellipsoid that should hold a share of them, see `squared_radius`.

    Args:
        nees: Normalised squared errors ``e' S^-1 e``, shape (N,).
        degrees_of_freedom: Those of each forecast, shape (N,).
        share: The share that should be inside, 0 to 1.

    Returns:
        Shape (N,); False where `nees` is NaN.
    """
    return np.asarray(nees <= squared_radius(degrees_of_freedom, share))
