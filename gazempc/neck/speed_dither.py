"""From a speed to one that the device has."""

from __future__ import annotations

from bisect import bisect_right

from gazempc.neck.spec import SpeedSteps


class SpeedDither:
    """Chooses among a device's speeds so that their mean is the wanted speed (first-order sigma-delta modulation).

    Of the two speeds next to the wanted one it chooses that which makes up for more of the angle by which the joint is
    behind. A wanted speed that the device has is chosen at once, so that a joint at rest stays there.

    Args:
        steps: Speeds of the device; None if it has all of them.
        most_rad_s: Top speed in use; faster steps are left out.

    Attributes:
        held_rad_s: The chosen speed with its sign, rad/s.
    """

    def __init__(self, steps: SpeedSteps | None, most_rad_s: float) -> None:
        self._most_rad_s = most_rad_s * (1.0 + 1e-6)
        levels = () if steps is None else steps.levels_rad_s
        self._levels = [level for level in levels if abs(level) <= self._most_rad_s]
        self._behind_rad = 0.0
        self.held_rad_s = 0.0

    def choose(self, wanted_rad_s: float, hold_s: float) -> float:
        """Choose a speed.

        Args:
            wanted_rad_s: The wanted speed, rad/s.
            hold_s: Time for which it will probably be held, seconds.

        Returns:
            The speed with its sign, rad/s.
        """
        if not self._levels:
            self.held_rad_s = min(max(wanted_rad_s, -self._most_rad_s), self._most_rad_s)
            return self.held_rad_s
        above = bisect_right(self._levels, wanted_rad_s)
        lower, upper = self._levels[max(above - 1, 0)], self._levels[min(above, len(self._levels) - 1)]
        if lower in (wanted_rad_s, upper):
            self._behind_rad, self.held_rad_s = 0.0, lower
            return lower
        # Anti-windup: at most what one hold can make up for.
        most_rad = (upper - lower) * hold_s
        self._behind_rad = min(max(self._behind_rad, -most_rad), most_rad)
        aim = wanted_rad_s + self._behind_rad / hold_s
        self.held_rad_s = upper if aim - lower > upper - aim else lower
        return self.held_rad_s

    def hold(self, wanted_rad_s: float, time_s: float) -> None:
        """Account for a time in which the chosen speed was held.

        Args:
            wanted_rad_s: The speed that was wanted meanwhile, rad/s.
            time_s: The time, seconds.
        """
        self._behind_rad += (wanted_rad_s - self.held_rad_s) * time_s
