"""Lines through a longer walk than the newest second: by them a tracker's wander is told from a change of direction."""

from __future__ import annotations

import math

import numpy as np

from predictors.types import FloatArray
from predictors.walker.line import Line

# Filters of constant velocity: power density of the acceleration, m^2/s^3, and s.d. of a position at 30 frames a
# second, metres. They remember about 0.4, 0.8 and 1.2 s, the filter of the line 0.2 s.
_FILTERS = ((0.05, 0.1), (0.05, 0.42), (0.0125, 0.42))
_USUAL_HZ = 30.0
# Frames count by the time that they stand for, within these limits.
_SHORTEST_S, _LONGEST_S = 1e-3, 0.1
_SPEED_VARIANCE_M2_S2 = 1.0
# Each input is of order one over walking people.
_POSITION_SCALE_M, _VELOCITY_SCALE_M_S = 0.05, 0.15
N_SLOW = 6 * len(_FILTERS)
SLOW_MIRROR = np.tile([1.0, -1.0, 1.0], 2 * len(_FILTERS))


class SlowLines:
    """Filters that take in the same positions as the line's, each with a longer memory.

    Plain numbers: on so few of them numpy takes several times as long. Gains depend on the times only, so all axes
    share them.
    """

    def __init__(self) -> None:
        self._time_s: float | None = None
        # Of each filter: variance of position, covariance with velocity, variance of velocity.
        self._spread = [(sd_m * sd_m, 0.0, _SPEED_VARIANCE_M2_S2) for _, sd_m in _FILTERS]
        self._states = [[0.0] * 6 for _ in _FILTERS]

    def add(self, time_s: float, position_m: FloatArray) -> None:
        """Take in the newest position.

        Args:
            time_s: Its time, seconds.
            position_m: The position, shape (3,), metres.
        """
        position = position_m.tolist()
        if self._time_s is None:
            self._time_s = time_s
            self._states = [[*position, 0.0, 0.0, 0.0] for _ in _FILTERS]
            return
        dt = time_s - self._time_s
        self._time_s = time_s
        frames = _USUAL_HZ * min(max(dt, _SHORTEST_S), _LONGEST_S)
        for k, (psd, sd_m) in enumerate(_FILTERS):
            x, y, z, u, v, w = self._states[k]
            old_pp, old_pv, old_vv = self._spread[k]
            pp = old_pp + dt * (2.0 * old_pv + dt * old_vv) + psd * dt**3 / 3.0
            pv = old_pv + dt * old_vv + psd * dt * dt / 2.0
            innovation = pp + sd_m * sd_m / frames
            gain, rate = pp / innovation, pv / innovation
            off_x, off_y, off_z = position[0] - x - dt * u, position[1] - y - dt * v, position[2] - z - dt * w
            self._states[k] = [
                x + dt * u + gain * off_x,
                y + dt * v + gain * off_y,
                z + dt * w + gain * off_z,
                u + rate * off_x,
                v + rate * off_y,
                w + rate * off_z,
            ]
            self._spread[k] = (1.0 - gain) * pp, (1.0 - gain) * pv, old_vv + psd * dt - rate * pv

    def inputs(self, line: Line) -> list[float]:
        """How these lines differ from the newest one.

        Args:
            line: The newest line, at the time of the newest position.

        Returns:
            Positions and velocities relative to the line, along, across and up, filter by filter; N_SLOW numbers, of
            order one.
        """
        c, s = math.cos(line.heading_rad), math.sin(line.heading_rad)
        newest = *line.origin_base_m.tolist(), *line.velocity_base_m_s.tolist()
        found = []
        for state in self._states:
            x, y, z, u, v, w = (own - other for own, other in zip(state, newest, strict=True))
            found += [(c * x + s * y) / _POSITION_SCALE_M, (c * y - s * x) / _POSITION_SCALE_M, z / _POSITION_SCALE_M]
            found += [(c * u + s * v) / _VELOCITY_SCALE_M_S, (c * v - s * u) / _VELOCITY_SCALE_M_S]
            found.append(w / _VELOCITY_SCALE_M_S)
        return found
