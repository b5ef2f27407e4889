"""Path of a walker at constant speed whose turn rate dies away; with no decay it is a circular arc."""

from __future__ import annotations

import numpy as np

from predictors.types import FloatArray

# Gauss-Legendre on [0, 1]. Five nodes are exact to 1e-8 for a turn of pi; and unlike the closed form of the arc,
# a quadrature has no singularity at a turn rate of zero.
_nodes, _weights = np.polynomial.legendre.leggauss(5)
NODES: FloatArray = (_nodes + 1.0) / 2.0
WEIGHTS: FloatArray = _weights / 2.0


def turned_per_rate_s(time_s: FloatArray, decay_time_s: float) -> FloatArray:
    """Angle turned over a time, per initial turn rate.

    Args:
        time_s: Times, any shape, seconds.
        decay_time_s: Time constant with which the turn rate dies away, seconds.

    Returns:
        Radians per rad/s, of the same shape; the time itself where the decay is slow.
    """
    return np.asarray(-decay_time_s * np.expm1(-time_s / decay_time_s), dtype=np.float64)


def arc(
    heading_rad: FloatArray, turn_rate_rad_s: FloatArray, time_s: FloatArray, decay_time_s: float
) -> tuple[FloatArray, FloatArray]:
    """Way made over a time, per speed.

    Args:
        heading_rad: Headings at the start, from +x towards +y, radians; broadcasts with the two below.
        turn_rate_rad_s: Turn rates at the start, rad/s.
        time_s: Times, seconds; zero and negative ones are fine.
        decay_time_s: Time constant with which the turn rate dies away, seconds.

    Returns:
        The way, metres per m/s, shape (..., 2), and its derivative to the turn rate, shape (..., 2).
    """
    time = np.asarray(time_s)[..., None]
    turned = turned_per_rate_s(time * NODES, decay_time_s)
    direction = np.asarray(heading_rad)[..., None] + np.asarray(turn_rate_rad_s)[..., None] * turned
    c, s = np.cos(direction), np.sin(direction)
    weight = time * WEIGHTS
    way = np.stack([np.sum(weight * c, axis=-1), np.sum(weight * s, axis=-1)], axis=-1)
    weight = weight * turned
    return way, np.stack([-np.sum(weight * s, axis=-1), np.sum(weight * c, axis=-1)], axis=-1)
