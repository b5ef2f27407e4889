"""The smooth paths that people walk before the robot: six routes, in time, placed in the camera's view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.integrate import cumulative_trapezoid

from gazempc.recordings.synthetic.gait import WalkerTraits, bounded_normal, slow_variation
from gazempc.types import FloatArray

FRAME_RATE_HZ = 30.0
ROUTE_RANGE_M = (1.1, 5.28)
"""Horizontal distance of the path from the sensor; leaves room for sway within the camera's 0.5-5.46 m."""
ROUTE_HALF_ANGLE_RAD = np.radians(36.0)  # Azure Kinect, narrow field of view: 37.5 deg, less room for sway
DURATION_RANGE_S = (4.6, 5.4)  # about 5 s in the paper
LONGEST_PATH_M = 5.9  # longest straight walk across the view

PEAK_RATE_90_RAD_S = np.radians((83.0, 92.0))  # peak turn rate in turns of 90 deg; the walks
PEAK_RATE_EXPONENT = 0.6  # of the peak turn rate over the angle: wider turns also last longer; our choice
SMALLEST_RADIUS_M = 0.4  # of turns while walking: 0.4-0.8 m on the walks
MINIMUM_JERK_PEAK = 1.875  # peak over mean rate of a minimum-jerk profile


@dataclass(frozen=True)
class Route:
    """A route of the experiment.

    Attributes:
        group: Label of the walks on it.
        description: In words.
        turn_deg: Range of the angle turned; positive to the person's left.
        heading_deg: Direction of travel at the start; 0 is away from the robot, 90 to the robot's left.
        middle_base_m: Position of the person, x and y, in the middle of the walk or of the turn.
    """

    group: Literal["straight", "turn", "sharp"]
    description: str
    turn_deg: tuple[float, float]
    heading_deg: float
    middle_base_m: tuple[float, float]


# The paper gives only the kinds of the six routes. Left and right are mirror images; on the turning routes
# the person comes toward the robot and turns off.
ROUTES = {
    "R1": Route("straight", "straight, to the robot's left", (0.0, 0.0), 95.0, (3.3, 0.0)),
    "R2": Route("straight", "straight, to the robot's right", (0.0, 0.0), -95.0, (3.3, 0.0)),
    "R3": Route("turn", "turn left", (45.0, 63.0), -170.0, (3.1, 0.9)),
    "R4": Route("turn", "turn right", (-63.0, -45.0), 170.0, (3.1, -0.9)),
    "R5": Route("sharp", "sharp turn left", (90.0, 120.0), -175.0, (2.9, 0.5)),
    "R6": Route("sharp", "sharp turn right", (-120.0, -90.0), 175.0, (2.9, -0.5)),
}


@dataclass(frozen=True)
class HeadingProfile:
    """A minimum-jerk turn between two directions of travel.

    Attributes:
        start_rad: Direction before the turn.
        turn_rad: Angle turned, positive to the left.
        middle_s: Time of the turn's middle.
        duration_s: Duration of the turn.
    """

    start_rad: float
    turn_rad: float
    middle_s: float
    duration_s: float

    def _fraction(self, times_s: FloatArray) -> FloatArray:
        return np.clip((times_s - self.middle_s) / self.duration_s + 0.5, 0.0, 1.0)

    def heading_rad(self, times_s: FloatArray) -> FloatArray:
        """Direction at `times_s` (shape (N,), seconds): minimum jerk; radians, shape (N,), unwrapped."""
        part = self._fraction(times_s)
        return self.start_rad + self.turn_rad * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)

    def rate_shape(self, times_s: FloatArray) -> FloatArray:
        """Turn rate at `times_s` (shape (N,), seconds) over its peak: 0 to 1, shape (N,)."""
        part = self._fraction(times_s)
        return 16.0 * part**2 * (1.0 - part) ** 2

    def rate_rad_s(self, times_s: FloatArray) -> FloatArray:
        """Turn rate at `times_s` (shape (N,), seconds): rad/s, shape (N,), positive to the left."""
        return MINIMUM_JERK_PEAK * self.turn_rad / self.duration_s * self.rate_shape(times_s)


@dataclass(frozen=True)
class TravelPath:
    """The smooth path of a walk, without the gait's sway, in the base frame.

    Attributes:
        times_s: Shape (N,), seconds, from 0 in steps of a frame.
        position_base_m: Shape (N, 2), x and y.
        speed_m_s: Shape (N,).
        heading_rad: Direction of travel, shape (N,), unwrapped.
        profile: The turn as intended; body and head anticipate it.
    """

    times_s: FloatArray
    position_base_m: FloatArray
    speed_m_s: FloatArray
    heading_rad: FloatArray
    profile: HeadingProfile


def _misplacement(position_base_m: FloatArray) -> FloatArray:
    """Distance by which paths, shape (..., N, 2), leave the camera's view: metres, shape (...), 0 inside."""
    x, y = position_base_m[..., 0], position_base_m[..., 1]
    distance = np.hypot(x, y)
    beyond = np.maximum(ROUTE_RANGE_M[0] - distance, distance - ROUTE_RANGE_M[1])
    beside = np.abs(y) * np.cos(ROUTE_HALF_ANGLE_RAD) - x * np.sin(ROUTE_HALF_ANGLE_RAD)
    worst = np.maximum(np.maximum(beyond, beside), 0.0).max(axis=-1)
    return np.asarray(worst)


def place_in_view(path_m: FloatArray, heading_rad: float, middle_base_m: FloatArray) -> tuple[float, FloatArray]:
    """Fit a path into the camera's view by the smallest sufficient rotation and shift.

    Args:
        path_m: Shape (N, 2), starts along +x, with the middle of the walk at the origin.
        heading_rad: Desired direction of travel at the start.
        middle_base_m: Desired position of the middle, shape (2,).

    Returns:
        Direction of travel at the start and place of the middle, shape (2,).
    """
    rotations = heading_rad + np.radians(np.arange(-50.0, 51.0, 5.0))
    steps = np.linspace(-1.2, 1.2, 13)
    shifts = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    cos, sin = np.cos(rotations), np.sin(rotations)
    turning = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    ends_and_bends = path_m[np.linspace(0, len(path_m) - 1, 16).astype(int)]
    turned = ends_and_bends @ turning.transpose(0, 2, 1)
    paths = turned[:, None] + (middle_base_m + shifts)[None, :, None]
    # A metre of shift counts as much as a radian of rotation; leaving the view outweighs both.
    # Rounded, so that ties, and thus the first minimum, are the same on all platforms.
    effort = np.abs(rotations - heading_rad)[:, None] + np.hypot(shifts[:, 0], shifts[:, 1])[None]
    best = np.argmin(effort.round(6) + 1e3 * _misplacement(paths))
    rotation, shift = divmod(int(best), len(shifts))
    return float(rotations[rotation]), middle_base_m + shifts[shift]


def walk_path(rng: np.random.Generator, walker: WalkerTraits, route: Route) -> TravelPath:
    """Draw one walk along a route.

    Speed falls to 0.6-0.75 of the cruise speed in turns of 90 deg (the walks), and rises and falls gently at
    both ends of the clip (short bouts are inverted U's: Carlisle & Kuo 2023; Seethapathi & Srinivasan).

    Args:
        rng: Random generator of this walk.
        walker: Traits of the person.
        route: The route.

    Returns:
        The path, inside the camera's view.
    """
    speed_m_s = walker.speed_m_s * bounded_normal(rng, 1.0, 0.03, 0.94, 1.04)
    duration_s = max(DURATION_RANGE_S[0], min(rng.uniform(*DURATION_RANGE_S), LONGEST_PATH_M / speed_m_s))
    times_s = np.arange(round(duration_s * FRAME_RATE_HZ)) / FRAME_RATE_HZ
    middle_s = 0.5 * times_s[-1] + bounded_normal(rng, 0.0, 0.15, -0.3, 0.3)

    # 8 +- 5 % within a clip on the walks counts turns and starts, which come on top of this here.
    wander = bounded_normal(rng, 0.035, 0.02, 0.01, 0.08) * slow_variation(rng, times_s, 0.4)
    bout = 1.0 - rng.uniform(0.0, 0.15) * (2.0 * times_s / times_s[-1] - 1.0) ** 2
    cruise_m_s = speed_m_s * bout * (1.0 + wander)

    turn_rad = np.radians(rng.uniform(*route.turn_deg))
    angle_per_90 = abs(turn_rad) / (0.5 * np.pi)
    slowing = rng.uniform(0.25, 0.40) * min(angle_per_90, 1.1)
    peak_rate = rng.uniform(*PEAK_RATE_90_RAD_S) * max(angle_per_90, 0.3) ** PEAK_RATE_EXPONENT
    slowest_m_s = (1.0 - slowing) * float(np.interp(middle_s, times_s, cruise_m_s))
    peak_rate = min(peak_rate, slowest_m_s / SMALLEST_RADIUS_M)
    turn_s = max(MINIMUM_JERK_PEAK * abs(turn_rad) / peak_rate, 1.0)
    profile = HeadingProfile(0.0, turn_rad, middle_s, turn_s)

    speeds_m_s = cruise_m_s * (1.0 - slowing * profile.rate_shape(times_s))
    # Straight walks wander by 4-15 deg from end to end on the walks, the pelvis's sway included.
    drift_rad = np.radians(rng.uniform(0.5, 1.8)) * slow_variation(rng, times_s, 0.35)
    headings_rad = profile.heading_rad(times_s) + drift_rad

    velocity_m_s = speeds_m_s[:, None] * np.stack([np.cos(headings_rad), np.sin(headings_rad)], axis=-1)
    path_m = cumulative_trapezoid(velocity_m_s, times_s, axis=0, initial=0)
    path_m -= path_m[int(np.searchsorted(times_s, middle_s))]
    heading_rad, middle_base_m = place_in_view(
        path_m,
        np.radians(route.heading_deg + rng.uniform(-12.0, 12.0)),
        np.asarray(route.middle_base_m) + rng.uniform(-0.3, 0.3, 2),
    )
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return TravelPath(
        times_s=times_s,
        position_base_m=middle_base_m + path_m @ np.array([[cos, sin], [-sin, cos]]),
        speed_m_s=speeds_m_s,
        heading_rad=headings_rad + heading_rad,
        profile=HeadingProfile(heading_rad, turn_rad, middle_s, turn_s),
    )
