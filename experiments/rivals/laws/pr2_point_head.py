"""PR2's point_head action with a goal for each detection: a cubic to the angles of the face, at rest at its end.

The goal is a point in space, by the head's pose at the *capture* of the frame (of a goal with that stamp). Each goal
starts a two-point trajectory from the present state, so the head follows a walking person in starts without ends.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BPoly

from experiments.rivals.rival import HeadCamera, Rival, View, point_base_m
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Delay from a goal to the start of its trajectory, and the shortest duration.
_START_S = 0.01
# Mean speed of a motion; free in the goal, this in the robot's tutorial.
_SPEED_RAD_S = 1.0


class Pr2PointHead(Rival):
    """Sends a two-point trajectory for each detection.

    Args:
        neck: Model of the neck: geometry and range.
        camera: Model of the camera.
        min_duration_s: Least duration of a motion; free in the goal, 0.5 in the robot's tutorial, seconds.
    """

    name = "pr2_point_head"
    free = tuple({"min_duration_s": duration_s} for duration_s in (0.1, 0.2, 0.5, 1.0))
    period_s = 0.01

    def __init__(self, neck: NeckSpec, camera: HeadCamera, *, min_duration_s: float = 0.5) -> None:
        super().__init__(neck, camera)
        self._min_duration_s = min_duration_s

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._goal_rad = view.joints.position_rad
        self._motion: BPoly | None = None

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        for detection in view.detections:
            head_rad = view.joints_at(detection.capture_time_s)
            if head_rad is not None:
                point_m = point_base_m(self._neck.geometry, self._camera, detection, head_rad)
                self._go(view.time_s, look_at_rad(self._neck.geometry, point_m))
        return self._at(view.time_s)[0]

    def _go(self, now_s: float, goal_rad: FloatArray) -> None:
        goal_rad = self._within_range(goal_rad)
        present = self._at(now_s)
        way_rad = float(np.abs(goal_rad - present[0]).max())
        duration_s = max(_START_S, self._min_duration_s, way_rad / _SPEED_RAD_S)
        start_s = now_s + _START_S
        # The initial state is held until the start: position and velocity at both ends make a cubic.
        states = [list(present), [goal_rad, np.zeros(2)]]
        self._motion = BPoly.from_derivatives([start_s, start_s + duration_s], states)
        self._goal_rad = goal_rad

    def _at(self, now_s: float) -> tuple[FloatArray, FloatArray]:
        """Position and velocity of the motion at a time."""
        if self._motion is None or now_s >= self._motion.x[-1]:
            return self._goal_rad, np.zeros(2)
        within_s = max(now_s, self._motion.x[0])
        return self._motion(within_s), self._motion(within_s, 1)
