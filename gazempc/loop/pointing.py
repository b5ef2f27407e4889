"""A gaze goal with precedence over people: from a ROS head action or a program."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.track import AroundTarget, Target
from gazempc.neck.kinematics import angle_between_rad
from gazempc.people.aversion import PEAK_VELOCITY, minimum_jerk
from gazempc.types import FloatArray, Sighting
from predictors import Forecast

# Share of the speed limit that a path uses, with room for overshoot.
_SPEED_SHARE = 0.85
# Small, but positive: a forecast needs an invertible covariance.
_VARIANCE_M2 = 1e-6


@dataclass(frozen=True)
class Place:
    """A place to look at, reached at once or along a path.

    Attributes:
        target_base_m: Position, shape (3,), metres, base frame.
        eye_base_m: Position of the eye at the start of the path, shape (3,), metres.
        from_direction: Gaze direction at the start, shape (3,), unit.
        start_s: Start time of the path, seconds on the loop's clock.
        lasts_s: Duration of the path, seconds; 0 for no path.
    """

    target_base_m: FloatArray
    eye_base_m: FloatArray
    from_direction: FloatArray
    start_s: float
    lasts_s: float = 0.0

    @classmethod
    def reached(
        cls,
        target_base_m: FloatArray,
        eye_base_m: FloatArray,
        from_direction: FloatArray,
        start_s: float,
        min_duration_s: float,
        max_velocity_rad_s: float,
    ) -> Place:
        """A place with a path of bounded duration and angular speed.

        Args:
            target_base_m: Position, shape (3,), metres, base frame.
            eye_base_m: Position of the eye, shape (3,), metres.
            from_direction: Present gaze direction, shape (3,), unit.
            start_s: Start time of the path, seconds.
            min_duration_s: Shortest duration, seconds.
            max_velocity_rad_s: Maximum angular speed of the path, rad/s.
        """
        to = target_base_m - eye_base_m
        by_speed_s = PEAK_VELOCITY * float(angle_between_rad(from_direction, to)) / (_SPEED_SHARE * max_velocity_rad_s)
        return cls(target_base_m, eye_base_m, from_direction, start_s, max(min_duration_s, by_speed_s))

    def at(self, times_s: FloatArray) -> FloatArray:
        """Gaze target, shape (H, 3), metres, at times of shape (H,), seconds."""
        if self.lasts_s <= 0.0:
            return np.tile(self.target_base_m, (times_s.size, 1))
        share = minimum_jerk(np.clip((times_s - self.start_s) / self.lasts_s, 0.0, 1.0))
        to = self.target_base_m - self.eye_base_m
        axis = np.cross(self.from_direction, to)
        if not axis.any():
            # Opposite direction: rotate about the vertical.
            axis = np.array([0.0, 0.0, 1.0])
        left_rad = (share - 1.0) * angle_between_rad(self.from_direction, to)
        turns = Rotation.from_rotvec(left_rad[:, None] * (axis / np.linalg.norm(axis)))
        return np.asarray(self.eye_base_m + turns.apply(to), dtype=np.float64)


class Goal:
    """Passes the place from the thread of a program to the loop.

    Attributes:
        place: The place; None for looking at people.
    """

    def __init__(self) -> None:
        self.place: Place | None = None


class Pointing(AroundTarget):
    """A target that is overridden by a place while one is set; people are tracked all the time.

    Args:
        target: The target without a place.
        goal: The place, if any.
    """

    def __init__(self, target: Target, goal: Goal) -> None:
        super().__init__(target)
        self._goal = goal
        self._now_s = 0.0

    @property
    def newest_capture_s(self) -> float | None:
        """See `gazempc.loop.track.Target`; the present time for a place."""
        return self._target.newest_capture_s if self._goal.place is None else self._now_s

    def assimilate(self, sightings: Iterable[Sighting], time_s: float, recorder: LoopRecorder) -> None:
        """See `gazempc.loop.track.Target.assimilate`."""
        self._now_s = time_s
        self._target.assimilate(sightings, time_s, recorder)

    def forecast(self, times_s: FloatArray, time_s: float, recorder: LoopRecorder) -> Forecast | None:
        """See `gazempc.loop.track.Target.forecast`: the place, or the forecast of the person."""
        place = self._goal.place
        if place is None:
            # The target may have been reset within the tick.
            return None if self._target.newest_capture_s is None else self._target.forecast(times_s, time_s, recorder)
        covariances_m2 = np.tile(_VARIANCE_M2 * np.eye(3), (times_s.size, 1, 1))
        return Forecast(times_s, place.at(times_s), covariances_m2, time_s)
