"""Quantised speeds of a device, and their modulation for a demanded speed."""

from __future__ import annotations

from bisect import bisect_right
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from gazempc.specfiles import Strict

# Lower bound: slower than any camera, a thousandth of a degree a second.
_Speed = Annotated[float, Field(ge=1e-5, le=1e3)]
_Speeds = Annotated[tuple[_Speed, ...], Field(min_length=1, max_length=1000)]


class SpeedSteps(Strict):
    """The quantised speeds of a joint, besides zero.

    Entry k - 1 is the speed of the device's step k: of pan or tilt speed k of VISCA, or of the share k / K of full
    speed by ONVIF, with K entries. The steps need not be linear, nor the same in both directions.
    """

    positive_rad_s: _Speeds = Field(description="To the left or up, slowest first, rad/s")
    negative_rad_s: _Speeds = Field(description="To the right or down, slowest first, rad/s; without a sign")

    @model_validator(mode="after")
    def _slowest_first(self) -> SpeedSteps:
        for name in ("positive_rad_s", "negative_rad_s"):
            speeds = getattr(self, name)
            if list(speeds) != sorted(speeds):
                raise ValueError(f"{name} must not decrease: step 1 is the slowest")
        return self

    @staticmethod
    def equal(most_rad_s: float, count: int) -> SpeedSteps:
        """Equidistant steps up to a top speed, rad/s, in both directions."""
        speeds = tuple(most_rad_s * (k + 1) / count for k in range(count))
        return SpeedSteps(positive_rad_s=speeds, negative_rad_s=speeds)

    @property
    def levels_rad_s(self) -> tuple[float, ...]:
        """All speeds with their signs, in ascending order and with 0, rad/s."""
        return (*(-speed for speed in reversed(self.negative_rad_s)), 0.0, *self.positive_rad_s)

    @property
    def fastest_rad_s(self) -> float:
        """Top speed of both directions, rad/s."""
        return min(self.positive_rad_s[-1], self.negative_rad_s[-1])

    def step(self, speed_rad_s: float) -> int:
        """The device's step with the nearest speed.

        Args:
            speed_rad_s: A speed, rad/s.

        Returns:
            Number of the step, 0 for zero speed; negative to the right or down.
        """
        return int(np.argmin(np.abs(np.array(self.levels_rad_s) - speed_rad_s))) - len(self.negative_rad_s)

    def speed_rad_s(self, step: int) -> float:
        """Speed of a step.

        Args:
            step: Number of the step, as in `step`.

        Returns:
            Signed speed, rad/s.
        """
        return self.levels_rad_s[step + len(self.negative_rad_s)]


class SpeedDither:
    """First-order sigma-delta modulation: the mean of the chosen speeds is the demanded speed.

    Of the two neighbours of the demanded speed, the one that leaves the smaller integrated error is chosen. A demanded
    speed among the steps is chosen at once, so that a joint at rest stays there.

    Args:
        steps: Speeds of the device; None for continuous speeds.
        most_rad_s: Top speed in use; faster steps are excluded.

    Attributes:
        held_rad_s: The chosen signed speed, rad/s.
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
            wanted_rad_s: The demanded speed, rad/s.
            hold_s: Expected holding time, seconds.

        Returns:
            The signed speed, rad/s.
        """
        if not self._levels:
            self.held_rad_s = min(max(wanted_rad_s, -self._most_rad_s), self._most_rad_s)
            return self.held_rad_s
        above = bisect_right(self._levels, wanted_rad_s)
        lower, upper = self._levels[max(above - 1, 0)], self._levels[min(above, len(self._levels) - 1)]
        if lower in (wanted_rad_s, upper):
            self._behind_rad, self.held_rad_s = 0.0, lower
            return lower
        # Anti-windup: bounded by the correction of one holding time.
        most_rad = (upper - lower) * hold_s
        self._behind_rad = min(max(self._behind_rad, -most_rad), most_rad)
        aim = wanted_rad_s + self._behind_rad / hold_s
        self.held_rad_s = upper if aim - lower > upper - aim else lower
        return self.held_rad_s

    def hold(self, wanted_rad_s: float, time_s: float) -> None:
        """Integrate the error over a holding time.

        Args:
            wanted_rad_s: The speed demanded meanwhile, rad/s.
            time_s: The holding time, seconds.
        """
        self._behind_rad += (wanted_rad_s - self.held_rad_s) * time_s
