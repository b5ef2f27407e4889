"""The shipped attention policies."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.neck.kinematics import wrapped_rad
from gazempc.part_options import make, options_for
from gazempc.parts import BY_NAME, POLICY
from gazempc.people.company import NOT_AT_ALL, AttentionPolicy, Company
from gazempc.people.person import PersonState

# Score of first choices: larger than the scores of all others, which are distances.
_FIRST = 1e3
# Minimum closing speed of an approach: slower motion is postural sway.
_APPROACHES_M_S = 0.3
# Gate of sound direction (error about 10 deg), and longest pause of a speaker.
_SPEAKER_WITHIN_RAD, _PAUSE_S = math.radians(20.0), 2.0
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


class Nearest:
    """The nearest person."""

    def reset(self) -> None:
        """See `AttentionPolicy.reset`."""

    def scores(self, company: Company) -> list[float]:
        """See `AttentionPolicy.scores`."""
        return [-person.distance_m for person in company.people]


class Approaching:
    """The person who approaches fastest; if none does, the nearest."""

    def reset(self) -> None:
        """See `AttentionPolicy.reset`."""

    def scores(self, company: Company) -> list[float]:
        """See `AttentionPolicy.scores`."""
        return [
            _FIRST + speed if (speed := closing_m_s(person)) >= _APPROACHES_M_S else -person.distance_m
            for person in company.people
        ]


class Engaged:
    """The nearest person engaged with the robot; if there is none, the nearest person.

    After the visual social engagement of Webb & Lemaignan ("Measuring Visual Social Engagement from Proxemics and
    Gaze"), as implemented by the ROS4HRI node hri_engagement: proximity of the robot to the axis of the person's gaze,
    times a factor that decreases with the logarithm of the distance, averaged over some seconds. The third factor,
    proximity of the person to the axis of the robot's gaze, is omitted: before the decision the robot looks elsewhere.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """See `AttentionPolicy.reset`."""
        self._seen: dict[int, deque[tuple[float, float]]] = {}
        self._decided: dict[int, bool] = {}

    def scores(self, company: Company) -> list[float]:
        """See `AttentionPolicy.scores`."""
        engaged = self.update(company)
        return [(_FIRST if engaged[p.number] else 0.0) - p.distance_m for p in company.people]

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


class Speaker:
    """The last speaker, by the direction of the sound; before any speech, the nearest person."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """See `AttentionPolicy.reset`."""
        self._spoke_s: dict[int, float] = {}
        self._heard_s = -math.inf

    def scores(self, company: Company) -> list[float]:
        """See `AttentionPolicy.scores`."""
        for sound in company.sounds:
            if sound.time_s <= self._heard_s or company.time_s - sound.time_s > _PAUSE_S:
                continue
            self._heard_s = sound.time_s
            xy_m = np.array([person.position_base_m[:2] for person in company.people]).reshape(-1, 2)
            off_rad = np.abs(wrapped_rad(np.arctan2(xy_m[:, 1], xy_m[:, 0]) - sound.azimuth_rad))
            if off_rad.min(initial=np.inf) <= _SPEAKER_WITHIN_RAD:
                self._spoke_s[company.people[int(off_rad.argmin())].number] = sound.time_s
        return [
            _FIRST - (company.time_s - self._spoke_s[person.number])
            if company.time_s - self._spoke_s.get(person.number, -math.inf) < _FIRST
            else -person.distance_m
            for person in company.people
        ]


class Named:
    """The person with a given tracker name only.

    Args:
        name: The name.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def reset(self) -> None:
        """See `AttentionPolicy.reset`."""

    def scores(self, company: Company) -> list[float]:
        """See `AttentionPolicy.scores`."""
        return [0.0 if person.tracker_id == self._name else NOT_AT_ALL for person in company.people]


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


def closing_m_s(person: PersonState) -> float:
    """Horizontal closing speed of a person, m/s."""
    distance_m = max(person.distance_m, 1e-6)
    return -float(person.position_base_m[:2] @ person.velocity_base_m_s[:2]) / distance_m


def make_policy(choice: str, options: dict[str, Any]) -> AttentionPolicy:
    """Construct a policy.

    Args:
        choice: A shipped name, ``id:NAME``, ``module:Class``, or a policy.
        options: Parameters of a user-defined policy.

    Returns:
        The policy.

    Raises:
        SettingsError: If construction fails, or a method is missing.
    """
    if choice.startswith(BY_NAME):
        return Named(choice.removeprefix(BY_NAME))
    policy: AttentionPolicy = make(POLICY, choice, {}, options_for(POLICY, choice, options))
    return policy
