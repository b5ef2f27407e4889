"""Engagement of people with the robot, by distance, gaze and time.

After the visual social engagement of Webb & Lemaignan ("Measuring Visual Social Engagement from Proxemics and Gaze"),
as implemented by the ROS4HRI node hri_engagement: proximity of the robot to the axis of the person's gaze, times a
factor that decreases with the logarithm of the distance, averaged over some seconds. The third factor, proximity of the
person to the axis of the robot's gaze, is omitted: before the decision the robot looks elsewhere.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.people.company import Company
from gazempc.people.person import PersonState

# From hri_engagement: half angle of a person's field of view, and maximum distance.
_FIELD_OF_VIEW_RAD, _FARTHEST_M = math.radians(60.0), 4.0
# Length of the window, and minimum observation time; as hri_engagement, which waits for half of its window.
WINDOW_S = 5.0
# Thresholds of the mean for engaged and disengaged, with hysteresis. On hri_engagement's recordings people who look at
# the robot have 0.61 to 0.84, the others 0.10 to 0.58. Its threshold, 0.5, includes the third factor.
_ENGAGED_ABOVE, _DISENGAGED_BELOW = 0.60, 0.58
# A longer gap without a face empties the window.
_GAP_S = 1.0
_FORWARD = np.array([1.0, 0.0, 0.0])


def visual_engagement(person: PersonState) -> float | None:
    """Instantaneous engagement of a person.

    Args:
        person: The person, with the orientation of the head.

    Returns:
        0 to 1; None if the orientation is unknown.
    """
    if person.head_quat_wxyz is None:
        return None
    range_m = float(np.linalg.norm(person.position_base_m))
    if not 0.0 < range_m < _FARTHEST_M:
        return 0.0
    forward = Rotation.from_quat(person.head_quat_wxyz, scalar_first=True).apply(_FORWARD)
    cos_off = -float(forward @ person.position_base_m) / range_m
    if cos_off <= 0.0:
        return 0.0
    off_rad = math.acos(min(cos_off, 1.0))
    gaze = max(0.0, 1.0 - math.tan(off_rad) / math.tan(_FIELD_OF_VIEW_RAD))
    return gaze * math.log(_FARTHEST_M - range_m + 1.0) / math.log(_FARTHEST_M + 1.0)


class Engagement:
    """Engagement of all people."""

    def __init__(self) -> None:
        self._seen: dict[int, deque[tuple[float, float]]] = {}
        self._decided: dict[int, bool] = {}

    def update(self, company: Company) -> dict[int, bool | None]:
        """Update the engagement of all people.

        Args:
            company: The people.

        Returns:
            Engagement by number of the person; None while undecided.
        """
        here = {person.number for person in company.people}
        self._seen = {number: seen for number, seen in self._seen.items() if number in here}
        self._decided = {number: engaged for number, engaged in self._decided.items() if number in here}
        for person in company.people:
            value = visual_engagement(person)
            if value is not None:
                self._update_person(person.number, company.time_s, value)
        return {person.number: self._decided.get(person.number) for person in company.people}

    def _update_person(self, number: int, time_s: float, value: float) -> None:
        seen = self._seen.setdefault(number, deque())
        if seen and time_s - seen[-1][0] > _GAP_S:
            seen.clear()
            self._decided.pop(number, None)
        seen.append((time_s, value))
        if time_s - seen[0][0] < WINDOW_S:
            return
        while time_s - seen[1][0] >= WINDOW_S:
            seen.popleft()
        mean = sum(each for _, each in seen) / len(seen)
        if mean > _ENGAGED_ABOVE:
            self._decided[number] = True
        elif mean < _DISENGAGED_BELOW:
            self._decided[number] = False
