"""Slower filters and running means of the position: context for walks, places for people who stay."""

from __future__ import annotations

import math

from predictors.types import FloatArray
from predictors.walker.line import Line

# Filters of constant velocity: power density of the acceleration, m^2/s^3, and s.d. of a position at 30 frames a
# second, metres. They remember about 0.4, 0.8 and 1.2 s, the filter of the line 0.2 s. They separate a tracker's
# wander from a change of direction.
_FILTERS = ((0.05, 0.1), (0.05, 0.42), (0.0125, 0.42))
_USUAL_HZ = 30.0
# Measurement noise scales with the frame interval, clipped to these limits.
_SHORTEST_S, _LONGEST_S = 1e-3, 0.1
_SPEED_VARIANCE_M2_S2 = 1.0
# Time constants of running means, seconds: a person who stays sways about them and returns to them.
_MEANS_S = (1.0, 2.5, 6.0)
# Scales that make each input of order one for people who walk or sway.
_POSITION_SCALE_M, _VELOCITY_SCALE_M_S = 0.05, 0.15
_MEAN_SCALE_M, _SWAY_SCALE_M, _LEAST_SWAY_M = 0.1, 0.05, 0.002
N_MEMORIES = 6 * len(_FILTERS) + 4 * len(_MEANS_S)
# Signs of the inputs with left and right exchanged.
MEMORIES_MIRROR = (*(1.0, -1.0, 1.0) * (2 * len(_FILTERS) + len(_MEANS_S)), *(1.0,) * len(_MEANS_S))
# Places at which the person may stay: the newest position, that of each filter, and each mean.
N_PLACES = 1 + len(_FILTERS) + len(_MEANS_S)


class Memories:
    """Filters and running means of the position, each slower than the line's filter.

    Python floats: for arrays this small numpy is several times slower. The gains depend on time alone, so all axes
    share them.
    """

    def __init__(self) -> None:
        self._time_s: float | None = None
        self._began_s = 0.0
        # Of each filter: variance of position, covariance with velocity, variance of velocity.
        self._spread = [(sd_m * sd_m, 0.0, _SPEED_VARIANCE_M2_S2) for _, sd_m in _FILTERS]
        self._states = [[0.0] * 6 for _ in _FILTERS]
        # Of each mean: x, y, z, and the mean square of the horizontal distance from it.
        self._means = [[0.0] * 4 for _ in _MEANS_S]

    def add(self, time_s: float, position_m: FloatArray) -> None:
        """Take in the newest position.

        Args:
            time_s: Its time, seconds.
            position_m: The position, shape (3,), metres.
        """
        position = position_m.tolist()
        if self._time_s is None:
            self._time_s = self._began_s = time_s
            self._states = [[*position, 0.0, 0.0, 0.0] for _ in _FILTERS]
            self._means = [[*position, 0.0] for _ in _MEANS_S]
            return
        dt = time_s - self._time_s
        self._time_s = time_s
        self._filter(dt, position)
        for mean, memory_s in zip(self._means, _MEANS_S, strict=True):
            gain = dt / (min(time_s - self._began_s, memory_s) + dt)
            off_x, off_y, off_z = (at - own for at, own in zip(position, mean, strict=False))
            mean[0] += gain * off_x
            mean[1] += gain * off_y
            mean[2] += gain * off_z
            mean[3] += gain * ((1.0 - gain) * (off_x * off_x + off_y * off_y) - mean[3])

    def _filter(self, dt: float, position: list[float]) -> None:
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

    def inputs(self, line: Line, newest_m: FloatArray) -> tuple[list[float], list[list[float]]]:
        """Filters and means relative to the newest line.

        Args:
            line: The newest line, at the time of the newest position.
            newest_m: Smoothed newest position, shape (3,), metres.

        Returns:
            Inputs of the networks, N_MEMORIES numbers of order one: positions and velocities of the filters relative to
            the line, along, across and up; the means; logarithms of the sway about them. And the N_PLACES places at
            which the person may stay, relative to the line's origin, along, across and up, metres.
        """
        c, s = math.cos(line.heading_rad), math.sin(line.heading_rad)
        at_x, at_y, at_z = line.origin_base_m.tolist()
        slope_x, slope_y, slope_z = line.velocity_base_m_s.tolist()

        def turned(x: float, y: float, z: float) -> list[float]:
            return [c * x + s * y, c * y - s * x, z]

        newest_x, newest_y, newest_z = newest_m.tolist()
        places = [turned(newest_x - at_x, newest_y - at_y, newest_z - at_z)]
        found: list[float] = []
        for x, y, z, u, v, w in self._states:
            places.append(turned(x - at_x, y - at_y, z - at_z))
            found += [part / _POSITION_SCALE_M for part in places[-1]]
            found += [part / _VELOCITY_SCALE_M_S for part in turned(u - slope_x, v - slope_y, w - slope_z)]
        for x, y, z, _ in self._means:
            places.append(turned(x - at_x, y - at_y, z - at_z))
            found += [part / _MEAN_SCALE_M for part in places[-1]]
        found += [math.log(max(math.sqrt(max(m2, 0.0)), _LEAST_SWAY_M) / _SWAY_SCALE_M) for *_, m2 in self._means]
        return found, places
