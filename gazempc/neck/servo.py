"""The joint's servo: second-order system with exact dead time."""

from __future__ import annotations

import math
from collections import deque
from functools import lru_cache

import numpy as np

from gazempc.neck.spec import Axis
from gazempc.types import FloatArray

_SAME_TIME_S = 1e-9


def servo_model(axis: Axis) -> FloatArray:
    """State-space model of the servo without its dead time: d/dt [q, q'] = A [q, q'] + B u.

    Args:
        axis: The joint.

    Returns:
        A and B side by side, shape (2, 3).
    """
    wn, zeta = axis.natural_frequency_rad_s, axis.damping_ratio
    return np.array([[0.0, 1.0, 0.0], [-(wn**2), -2.0 * zeta * wn, wn**2]])


def zero_order_hold(axis: Axis, dt_s: float) -> FloatArray:
    """Exact discretisation of the servo with zero-order hold.

    Args:
        axis: The joint.
        dt_s: Time step, seconds.

    Returns:
        [Ad Bd], shape (2, 3), so that [q, q'] after the step is ``[Ad Bd] @ [q, q', u]``.
    """
    return np.array(_transition(axis.natural_frequency_rad_s, axis.damping_ratio, dt_s)).reshape(2, 3)


# Cached: a replay has few different steps. Safe: arguments and result are immutable.
@lru_cache(maxsize=256)
def _transition(wn: float, zeta: float, dt_s: float) -> tuple[float, ...]:
    """[Ad Bd] row by row, in closed form, in microseconds: with clock jitter every step differs.

    With s = sqrt(zeta^2 - 1) wn dt the matrix exponential of A dt is
    ``exp(-zeta wn dt) (cosh(s) I + sinh(s) / s (A + zeta wn I) dt)``; below zeta = 1 with cos and sin in place of cosh
    and sinh, at zeta = 1 with their limits.
    """
    decay, square = zeta * wn * dt_s, (zeta**2 - 1.0) * (wn * dt_s) ** 2
    s = math.sqrt(abs(square))
    if square > 0.0:
        # Decay and growth in one exponent: cosh alone could overflow.
        slow, fast = math.exp(s - decay), math.exp(-s - decay)
        even, odd = 0.5 * (slow + fast), 0.5 * (slow - fast) / s
    else:
        even = math.exp(-decay) * math.cos(s)
        odd = math.exp(-decay) * (math.sin(s) / s if s > 0.0 else 1.0)
    stays = even + decay * odd
    return stays, odd * dt_s, 1.0 - stays, -(wn**2) * dt_s * odd, even - decay * odd, wn**2 * dt_s * odd


class DelayedServo:
    """One simulated joint. Commands act exactly `dead_time_s` after they were sent, also between ticks.

    A velocity-controlled joint follows the integral of the acting speed, from its initial position.

    Args:
        axis: The joint.
        position_rad: Initial position and command, at rest, radians.
        time_s: Initial time, seconds.
        stops_rad: Lower and upper saturation of the integral of the speeds, radians.
    """

    def __init__(
        self,
        axis: Axis,
        position_rad: float,
        time_s: float = 0.0,
        stops_rad: tuple[float, float] = (-math.inf, math.inf),
    ) -> None:
        self._wn, self._zeta, self._dead_time_s = axis.natural_frequency_rad_s, axis.damping_ratio, axis.dead_time_s
        self._lag_s, self._takes_speed, self._stops_rad = axis.servo_lag_s, axis.takes_speed, stops_rad
        self._time_s = time_s
        self._q, self._v = position_rad, 0.0
        self._acting_rad, self._acting_rad_s = position_rad, 0.0
        self._waiting: deque[tuple[float, float]] = deque()

    @property
    def state(self) -> tuple[float, float]:
        """Joint position and velocity, radians and rad/s."""
        return self._q, self._v

    def send(self, command: float) -> None:
        """Send a command at the present time.

        Args:
            command: Position, radians, or speed, rad/s, by the type of the axis; held until the next one.
        """
        self._waiting.append((self._time_s + self._dead_time_s, command))

    def correct(self, position_rad: float, velocity_rad_s: float) -> None:
        """Add to position and velocity: the correction step of an observer."""
        self._q += position_rad
        self._v += velocity_rad_s

    def stand(self, position_rad: float) -> None:
        """Set state and acting command to rest at a position: the initialisation of an observer."""
        self._q, self._v, self._acting_rad, self._acting_rad_s = position_rad, 0.0, position_rad, 0.0

    def advance_to(self, time_s: float) -> None:
        """Simulate up to a time.

        Args:
            time_s: New time, seconds, not before the present one.

        Raises:
            ValueError: If the new time is before the present one.
        """
        if time_s < self._time_s - _SAME_TIME_S:
            raise ValueError(f"time cannot run backwards: {self._time_s} -> {time_s}")
        waiting = self._waiting
        while waiting and waiting[0][0] <= time_s + _SAME_TIME_S:
            acts_at_s, command = waiting.popleft()
            if acts_at_s > self._time_s:
                self._hold_until(acts_at_s)
            if self._takes_speed:
                self._acting_rad_s = command
            else:
                self._acting_rad = command
        if time_s > self._time_s:
            self._hold_until(time_s)

    def _hold_until(self, time_s: float) -> None:
        dt_s = time_s - self._time_s
        self._time_s = time_s
        if dt_s <= _SAME_TIME_S:
            return
        speed = self._acting_rad_s
        if speed != 0.0:
            low_rad, high_rad = self._stops_rad
            free_s = max(((high_rad if speed > 0.0 else low_rad) - self._acting_rad) / speed, 0.0)
            self._ramp(min(free_s, dt_s), speed)
            if free_s >= dt_s:
                return
            dt_s -= free_s
        qq, qv, qu, vq, vv, vu = _transition(self._wn, self._zeta, dt_s)
        q, v, u = self._q, self._v, self._acting_rad
        self._q, self._v = qq * q + qv * v + qu * u, vq * q + vv * v + vu * u

    def _ramp(self, dt_s: float, speed: float) -> None:
        # Ramp response: the particular solution trails by the lag, the deviation from it decays.
        qq, qv, _, vq, vv, _ = _transition(self._wn, self._zeta, dt_s)
        settled = self._acting_rad - speed * self._lag_s
        q, v = self._q - settled, self._v - speed
        self._q = qq * q + qv * v + settled + speed * dt_s
        self._v = vq * q + vv * v + speed
        self._acting_rad += speed * dt_s
