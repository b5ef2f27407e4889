"""Optimality conditions of a solution, checked from the solution alone.

For the program of `gazempc.controllers.mpc.qp`, x with -1 <= x <= 1 is optimal if and only if there are
multipliers m of the soft rows and b of the bounds with

    H x + g + A' m + b = 0

where m_i = rho if row i is beyond its upper bound, in [0, rho] if it is on it, 0 between the bounds, in [-rho, 0] on
the lower bound and -rho beyond it; b_j >= 0 where x_j = 1, <= 0 where x_j = -1, else 0. These are the conditions of
Karush, Kuhn and Tucker (Nocedal & Wright 2006, Numerical Optimization, theorem 12.1; enough since the program is
convex, section 16.1); rho bounds m because the exact penalty's slope does (section 17.2). The multipliers that fit best
are found by bounded least squares, and what then is left of the equation is the residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from gazempc.controllers.mpc.qp import QpData
from gazempc.types import FloatArray


@dataclass(frozen=True)
class KktResidual:
    """Residuals of the optimality conditions; dimensionless.

    Attributes:
        stationarity: Largest element of H x + g + A' m + b, as a share of the largest element of H x and g.
        bound: Largest violation of -1 <= x <= 1; 0 if there is none.
    """

    stationarity: float
    bound: float


def kkt_residual(
    data: QpData, g: FloatArray, lower: FloatArray, upper: FloatArray, x: FloatArray, tolerance: float = 1e-4
) -> KktResidual:
    """Residuals of the optimality conditions at a point.

    Args:
        data: The constant part of the program.
        g: Linear cost, shape (n,).
        lower: Lower bounds of the soft rows, shape (m,), as shares of their limits.
        upper: Upper bounds, shape (m,), above the lower ones by more than twice `tolerance`.
        x: The point, shape (n,), as shares of the bounds.
        tolerance: A row or variable within this share of its bound counts as active: solvers satisfy bounds
            to a tolerance only, and interior-point solvers stop inside.

    Returns:
        The residuals; NaN if `x` is.
    """
    if not np.all(np.isfinite(x)):
        return KktResidual(np.nan, np.nan)
    rows = data.a @ x
    above, below = rows - upper, lower - rows
    cost = np.stack([data.h @ x, g])
    size = max(float(np.abs(cost).max()), float(np.finfo(np.float64).tiny))
    beyond = (above > tolerance).astype(np.float64) - (below > tolerance)
    left = (cost.sum(axis=0) + data.penalty * (data.a.T @ beyond)) / size
    # A column for each multiplier that may be chosen, all in units of `size`.
    eye = np.eye(x.size)
    on_bound = np.vstack([data.a[np.abs(above) <= tolerance], -data.a[np.abs(below) <= tolerance]])
    at_bound = np.vstack([eye[x >= 1.0 - tolerance], -eye[x <= -1.0 + tolerance]])
    columns = np.vstack([on_bound, at_bound]).T
    if columns.size:
        most = np.repeat([data.penalty / size, np.inf], [len(on_bound), len(at_bound)])
        fit = lsq_linear(columns, -left, (0.0, most), "bvls", tol=1e-15, max_iter=20 * most.size)
        left = left + columns @ fit.x
    return KktResidual(float(np.abs(left).max()), max(float(np.abs(x).max()) - 1.0, 0.0))
