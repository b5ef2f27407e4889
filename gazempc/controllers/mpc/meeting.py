"""Who was far off the gaze a moment ago, and how far short of them to aim until they are met."""

from __future__ import annotations

import math

# Who is farther than this off the gaze has come into view, and is met for so long from then on.
MEETING_FROM_RAD = math.radians(15.0)
MEETING_S = 2.0
# Aimed short by this share of the forecast's standard deviation, at most by the last.
_SHORT = 0.1
_SHORT_MAX_RAD = math.radians(1.0)
# With more than this on the other side (there is no eye contact any more) the joint comes from there.
_OTHER_SIDE_RAD = math.radians(2.6)


class Meeting:
    """Watches one joint for a person far off.

    The forecast of somebody who has just come into view is put right while the gaze is on its way, and carries it past
    them. Falling short of them by half a degree is eye contact still, passing them by two is not.

    Args:
        answer_s: Dead time and servo lag of the joint, seconds.
        low_rad: Least angle that it is commanded to, radians.
        high_rad: Greatest one, radians.
    """

    def __init__(self, answer_s: float, low_rad: float, high_rad: float) -> None:
        self._answer_s, self._low_rad, self._high_rad = answer_s, low_rad, high_rad
        self.reset()

    def reset(self) -> None:
        """Forget who is met."""
        self._far_off_s, self._side = -math.inf, 0.0

    def short_rad(
        self, start_s: float, joint_rad: float, aim_rad: float, turning_rad_s: float, sigma_rad: float
    ) -> float | None:
        """Take in where the joint and the person will be and say how to aim.

        Args:
            start_s: Time of the plan, seconds.
            joint_rad: Where the joint will be when the plan begins to show, radians.
            aim_rad: Where it would look at the person then, radians.
            turning_rad_s: How fast that turns, rad/s.
            sigma_rad: Its standard deviation, radians; not a number counts as large.

        Returns:
            What to subtract from the aim, so that it is short of the person on the side that the joint comes from,
            radians; None if nobody is met.
        """
        gap_rad = aim_rad - joint_rad
        side = math.copysign(1.0, gap_rad)
        # A joint that waits at its limit for somebody out of reach is where it can be; and what a walker goes before
        # the neck answers is not being far off.
        to_go_rad = abs(min(max(aim_rad, self._low_rad), self._high_rad) - joint_rad)
        if to_go_rad - max(side * turning_rad_s * self._answer_s, 0.0) > MEETING_FROM_RAD:
            self._far_off_s, self._side = start_s, side
        elif abs(gap_rad) > _OTHER_SIDE_RAD:
            self._side = side
        still = 1.0 - (start_s - self._far_off_s) / MEETING_S
        if not 0.0 < still <= 1.0:
            return None
        short_rad = _SHORT * sigma_rad
        return self._side * still * (short_rad if short_rad < _SHORT_MAX_RAD else _SHORT_MAX_RAD)
