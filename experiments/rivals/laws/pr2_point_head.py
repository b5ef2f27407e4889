"""PR2's point_head action, a new goal for each detection: a cubic to the face's angles, at rest there.

The goal is a point in space, with the head's pose when the frame was *captured* (if the goal is stamped so). Each goal
starts a new two-point trajectory from the present state. It ends at rest, so a walking person is followed in starts
that never come to their ends.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BPoly

from experiments.rivals.rival import HeadCamera, Rival, View, point_base_m
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# A trajectory starts so much later than its goal is handled, and is at least so long.
_START_S = 0.01


class Pr2PointHead(Rival):
    """Sends a two-point trajectory for each detection.

    Args:
        neck: Its geometry and its range.
        camera: The camera on the head.
        min_duration_s: Least duration of a motion; free in the goal, 0.5 in the robot's tutorial, seconds.
        max_velocity_rad_s: Mean speed of a motion; free in the goal, 1.0 in the robot's tutorial, rad/s.
    """

    name = "pr2_point_head"
    free = tuple({"min_duration_s": duration_s} for duration_s in (0.1, 0.2, 0.5, 1.0))
    period_s = 0.01

    def __init__(
        self, neck: NeckSpec, camera: HeadCamera, *, min_duration_s: float = 0.5, max_velocity_rad_s: float = 1.0
    ) -> None:
        self._neck, self._camera = neck, camera
        self._min_duration_s, self._max_velocity_rad_s = min_duration_s, max_velocity_rad_s

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
        goal_rad = np.clip(goal_rad, self._neck.position_min_rad, self._neck.position_max_rad)
        present = self._at(now_s)
        way_rad = float(np.abs(goal_rad - present[0]).max())
        duration_s = max(_START_S, self._min_duration_s, way_rad / self._max_velocity_rad_s)
        start_s = now_s + _START_S
        # Until it starts, the state that it starts from is held: position and velocity at the ends make a cubic.
        states = [list(present), [goal_rad, np.zeros(2)]]
        self._motion = BPoly.from_derivatives([start_s, start_s + duration_s], states)
        self._goal_rad = goal_rad

    def _at(self, now_s: float) -> tuple[FloatArray, FloatArray]:
        """Position and velocity of the motion at a time."""
        if self._motion is None or now_s >= self._motion.x[-1]:
            return self._goal_rad, np.zeros(2)
        within_s = max(now_s, self._motion.x[0])
        return self._motion(within_s), self._motion(within_s, 1)
