"""Slower filters and running means of the position: inputs of the networks, and candidate places of staying."""

from __future__ import annotations

import math

import numpy as np

from predictors.types import FloatArray
from predictors.walker.line import Line

# Filters of constant velocity: power density of the acceleration, m^2/s^3, and s.d. of a position at 30 frames a
# second, metres. Time constants of about 0.4, 0.8 and 1.2 s, against 0.2 s of the line's filter, separate a tracker's
# drift from a change of direction.
_FILTERS = ((0.05, 0.1), (0.05, 0.42), (0.0125, 0.42))
_USUAL_HZ = 30.0
# Limits of the frame interval with which the measurement noise scales.
_SHORTEST_S, _LONGEST_S = 1e-3, 0.1
_SPEED_VARIANCE_M2_S2 = 1.0
# Time constants of running means, seconds: a standing person sways about the mean position.
_MEANS_S = (1.0, 2.5, 6.0)
# Scales that make each input of order one for walking or swaying people.
_POSITION_SCALE_M, _VELOCITY_SCALE_M_S = 0.05, 0.15
_MEAN_SCALE_M, _SWAY_SCALE_M, _LEAST_SWAY_M = 0.1, 0.05, 0.002
N_MEMORIES = 6 * len(_FILTERS) + 4 * len(_MEANS_S)
# Signs of the inputs under a left-right reflection.
MEMORIES_MIRROR = (*(1.0, -1.0, 1.0) * (2 * len(_FILTERS) + len(_MEANS_S)), *(1.0,) * len(_MEANS_S))
# Candidate places of staying: the newest position, the position of each filter, and each mean.
N_PLACES = 1 + len(_FILTERS) + len(_MEANS_S)


class Memories:
    """Filters and running means of the position, all slower than the line's filter.

    Plain floats: NumPy is several times slower for arrays this small. The gains depend on time alone and are common to
    all axes.
    """

    def __init__(self) -> None:
        self._time_s: float | None = None
        self._began_s = 0.0
        # Variance of position, covariance of position and velocity, variance of velocity of each filter.
        self._spread = [(sd_m * sd_m, 0.0, _SPEED_VARIANCE_M2_S2) for _, sd_m in _FILTERS]
        # Position and velocity of each filter on each axis.
        self._states = [[(0.0, 0.0)] * 3 for _ in _FILTERS]
        # x, y, z, and mean squared horizontal distance from the mean.
        self._means = [[0.0] * 4 for _ in _MEANS_S]

    def add(self, time_s: float, position_m: FloatArray) -> None:
        """Update with the newest position.

        Args:
            time_s: Capture time, seconds.
            position_m: Position, shape (3,), metres.
        """
        position = position_m.tolist()
        if self._time_s is None:
            self._time_s = self._began_s = time_s
            self._states = [[(at, 0.0) for at in position] for _ in _FILTERS]
            self._means = [[*position, 0.0] for _ in _MEANS_S]
            return
        dt = time_s - self._time_s
        self._time_s = time_s
        self._filter(dt, position)
        for mean, memory_s in zip(self._means, _MEANS_S, strict=True):
            gain = dt / (min(time_s - self._began_s, memory_s) + dt)
            off_x, off_y, off_z = (at - own for at, own in zip(position, mean, strict=False))
            square_m2 = (1.0 - gain) * (off_x * off_x + off_y * off_y)
            for k, off in enumerate((off_x, off_y, off_z, square_m2 - mean[3])):
                mean[k] += gain * off

    def _filter(self, dt: float, position: list[float]) -> None:
        frames = _USUAL_HZ * min(max(dt, _SHORTEST_S), _LONGEST_S)
        for k, (psd, sd_m) in enumerate(_FILTERS):
            old_pp, old_pv, old_vv = self._spread[k]
            pp = old_pp + dt * (2.0 * old_pv + dt * old_vv) + psd * dt**3 / 3.0
            pv = old_pv + dt * old_vv + psd * dt * dt / 2.0
            innovation = pp + sd_m * sd_m / frames
            gain, rate = pp / innovation, pv / innovation
            moved = [(at - p - dt * v, p + dt * v, v) for at, (p, v) in zip(position, self._states[k], strict=True)]
            self._states[k] = [(p + gain * off, v + rate * off) for off, p, v in moved]
            self._spread[k] = (1.0 - gain) * pp, (1.0 - gain) * pv, old_vv + psd * dt - rate * pv

    def inputs(self, line: Line, newest_m: FloatArray) -> tuple[list[float], FloatArray]:
        """Filters and means relative to the newest line.

        Args:
            line: The newest line, at the time of the newest position.
            newest_m: Smoothed newest position, shape (3,), metres.

        Returns:
            Inputs of the networks, N_MEMORIES numbers of order one: positions and velocities of the filters relative to
            the line, along, across and up; the means; logarithms of the RMS sway. And the N_PLACES candidate places of
            staying relative to the line's origin, along, across and up, shape (N_PLACES, 3), metres.
        """
        c, s = math.cos(line.heading_rad), math.sin(line.heading_rad)
        at_x, at_y, at_z = line.origin_base_m.tolist()
        velocity_x, velocity_y, velocity_z = line.velocity_base_m_s.tolist()

        def rotated(x: float, y: float, z: float) -> list[float]:
            return [c * x + s * y, c * y - s * x, z]

        newest_x, newest_y, newest_z = newest_m.tolist()
        places = [rotated(newest_x - at_x, newest_y - at_y, newest_z - at_z)]
        features: list[float] = []
        for (x, u), (y, v), (z, w) in self._states:
            places.append(rotated(x - at_x, y - at_y, z - at_z))
            features += [part / _POSITION_SCALE_M for part in places[-1]]
            features += [part / _VELOCITY_SCALE_M_S for part in rotated(u - velocity_x, v - velocity_y, w - velocity_z)]
        for x, y, z, _ in self._means:
            places.append(rotated(x - at_x, y - at_y, z - at_z))
            features += [part / _MEAN_SCALE_M for part in places[-1]]
        features += [math.log(max(math.sqrt(max(m2, 0.0)), _LEAST_SWAY_M) / _SWAY_SCALE_M) for *_, m2 in self._means]
        return features, np.array(places)
