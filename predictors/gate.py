"""Which detections a track refuses, and when it is given up: the same for all filters."""

from __future__ import annotations

from scipy.special import chdtri

from predictors.types import FloatArray

# An innovation this improbable is a mistaken detection (another person, a reflection), not a step of a walk.
_GATE_PROBABILITY = 0.999
# Quantile of chi-square with 3 degrees of freedom; `scipy.stats` has it, too, and takes half a second to import.
_GATE_D2 = float(chdtri(3, 1.0 - _GATE_PROBABILITY))
# A person who turns leaves the forecast of a steady walk by more than the filter's own spread tells; without this
# allowance the gate would refuse people in sharp turns. A false detection half a metre away is still refused.
_MANOEUVRE_SD_M = 0.08
# Real detectors fail in bursts; a track is given up only after this many refusals in a row, about a third of
# a second at 30 fps.
_REJECTIONS_BEFORE_RESTART = 10


class Gate:
    """Refuses positions that are improbable at the 99.9 % level, with an allowance for turning, and counts them."""

    def __init__(self) -> None:
        self._rejections = 0

    @property
    def rejections_in_a_row(self) -> int:
        """Number of observations refused since the last accepted one."""
        return self._rejections

    @property
    def lost(self) -> bool:
        """Whether so many were refused in a row that the track should start anew."""
        return self._rejections >= _REJECTIONS_BEFORE_RESTART

    def accepts(self, innovation_m: FloatArray, spread_m2: FloatArray) -> bool:
        """Judge one observation.

        Args:
            innovation_m: Observed minus predicted position, shape (3,), metres.
            spread_m2: Its covariance as the filter has it, shape (3, 3), square metres.

        Returns:
            Whether the observation is to be used.
        """
        distance2 = _distance2(innovation_m, spread_m2, _MANOEUVRE_SD_M**2)
        accepted = distance2 <= _GATE_D2  # a NaN, from a position of absurd size, is refused too
        self._rejections = 0 if accepted else self._rejections + 1
        return accepted

    def reset(self) -> None:
        """Forget the refusals, for a track that starts anew."""
        self._rejections = 0


def _distance2(innovation_m: FloatArray, spread_m2: FloatArray, allowance_m2: float) -> float:
    # Squared Mahalanobis distance by the L D L' factors of the matrix, in plain numbers: numpy's solver takes several
    # times as long for three of them.
    x, y, z = innovation_m.tolist()
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = spread_m2.tolist()
    d_x = xx + allowance_m2
    l_yx, l_zx = xy / d_x, xz / d_x
    d_y = yy + allowance_m2 - l_yx * xy
    l_zy = (yz - l_zx * xy) / d_y
    d_z = zz + allowance_m2 - l_zx * xz - l_zy * (yz - l_zx * xy)
    y -= l_yx * x
    z -= l_zx * x + l_zy * y
    distance2: float = x * x / d_x + y * y / d_y + z * z / d_z
    return distance2
