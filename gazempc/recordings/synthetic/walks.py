"""Synthetic walks before the robot: 14 people on 6 routes, after the paper's experiment.

The walks are made from their names alone, out of published figures for human locomotion, so that all experiments run
without recordings of people. They do not replace recordings of people: results hold for this model's motion only.

The origin of the frame is the robot's sensor and the axis of its neck's pan, 1.2 m above the floor; x is
forward, y left, z up.

Figures marked "the walks" were measured on 64 motion-capture clips of the CMU database; only the figures are used here,
none of the clips' data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from gazempc.recordings.recording import Labels, Recording, Track, turned
from gazempc.recordings.synthetic.gait import (
    PELVIS_HEIGHT_RATIO,
    WalkerTraits,
    bounded_normal,
    draw_walkers,
    slow_variation,
    walk_motion,
)
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
    x, y = np.moveaxis(turned[:, None] + (middle_base_m + shifts)[None, :, None], -1, 0)
    distance = np.hypot(x, y)
    beyond = np.maximum(ROUTE_RANGE_M[0] - distance, distance - ROUTE_RANGE_M[1])
    beside = np.abs(y) * np.cos(ROUTE_HALF_ANGLE_RAD) - x * np.sin(ROUTE_HALF_ANGLE_RAD)
    outside = np.maximum(np.maximum(beyond, beside), 0.0).max(axis=-1)
    # A metre of shift counts as much as a radian of rotation; leaving the view outweighs both.
    # Rounded, so that ties, and thus the first minimum, are the same on all platforms.
    effort = np.abs(rotations - heading_rad)[:, None] + np.hypot(shifts[:, 0], shifts[:, 1])[None]
    best = np.argmin(effort.round(6) + 1e3 * outside)
    rotation, shift = divmod(int(best), len(shifts))
    return float(rotations[rotation]), middle_base_m + shifts[shift]


def walk_path(
    rng: np.random.Generator, walker: WalkerTraits, route: Route
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, HeadingProfile]:
    """Draw one walk along a route.

    Speed falls to 0.6-0.75 of the cruise speed in turns of 90 deg (the walks), and rises and falls gently at
    both ends of the clip (short bouts are inverted U's: Carlisle & Kuo 2023; Seethapathi & Srinivasan).

    Args:
        rng: Random generator of this walk.
        walker: Traits of the person.
        route: The route.

    Returns:
        Times, shape (N,), seconds, from 0 in steps of a frame; the smooth path inside the camera's view, without the
        gait's sway, x and y in the base frame, shape (N, 2), metres; speed, shape (N,), metres per second; direction of
        travel, shape (N,), radians, unwrapped; and the turn as intended, which body and head anticipate.
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
    path_base_m = middle_base_m + rotated(path_m, heading_rad)
    profile = HeadingProfile(heading_rad, turn_rad, middle_s, turn_s)
    return times_s, path_base_m, speeds_m_s, headings_rad + heading_rad, profile


SENSOR_HEIGHT_M = 1.2

DATASET_SEED = 2021
SUBJECTS = 14
_HIGHEST_WANDER_HZ = 0.8  # of the head's angles; the walks: nearly all power below 1 Hz
PITCH_WANDER_RAD = np.radians(1.8)  # with the swing of gait 2.2 deg in all, as on the walks
ROLL_WANDER_RAD = np.radians(1.2)  # likewise 1.4 deg
_LEAN_RATIO = 0.3  # of the lean into turns over that of an inverted pendulum; 0.28-0.36 on the walks
_HEAD_TURN_SHORTENING = (0.0, 0.4)  # of the head's turn against the body's in sharp turns
_GRAVITY_M_S2 = 9.81

# Azure Kinect: random depth error up to 17 mm at 3.5 m, bias below 11 mm (Toelgyessy 2021). The random error
# is taken to grow in proportion to the distance up to there and, without published figures, to be constant beyond.
_DEPTH_NOISE_M = 0.017
_DEPTH_NOISE_DISTANCE_M = 3.5
_DEPTH_BIAS_M = 0.011
_LATERAL_NOISE_RATIO = 0.35  # of the noise across the ray over that along it; our choice
_YAW_NOISE_RAD = np.radians(2.0)  # the reference sensor's
_MISSING_SHARE = 0.01  # of frames without a person found; our choice


def synthetic_names() -> tuple[str, ...]:
    """Names of all 84 recordings, ``subject01_R1`` to ``subject14_R6``."""
    return tuple(f"subject{number:02}_{route}" for number in range(1, SUBJECTS + 1) for route in ROUTES)


def generate(name: str) -> Recording:
    """Generate one recording of the synthetic data set; deterministic in its name.

    Args:
        name: One of `synthetic_names`.

    Returns:
        The walk with exact truth and simulated measurements of a body tracker.
    """
    subject, route_name = name.split("_")
    number, route_number = int(subject.removeprefix("subject")), int(route_name.removeprefix("R"))
    route = ROUTES[route_name]
    # Separate streams, so that a change of the noise does not change the motion.
    motion_rng, noise_rng = (np.random.default_rng([DATASET_SEED, number, route_number, k]) for k in (1, 2))
    walker = draw_walkers(np.random.default_rng(DATASET_SEED), SUBJECTS)[number - 1]
    times_s, truth = _true_track(motion_rng, walker, route)
    description = f"synthetic walk, route {route_name}: {route.description}"
    return synthetic(name, times_s, truth, noise_rng, Labels(subject, route.group, description))


def synthetic(
    name: str, times_s: FloatArray, truth: Track, noise_rng: np.random.Generator, labels: Labels
) -> Recording:
    """A recording of exact truth, with simulated measurements of a body tracker at the origin of the frame."""
    measured = measured_track(noise_rng, truth)
    return Recording(name, "synthetic", "synthetic", times_s, truth, measured, has_robot=True, labels=labels)


def _true_track(rng: np.random.Generator, walker: WalkerTraits, route: Route) -> tuple[FloatArray, Track]:
    """Times, and gait, anticipation and gaze on a path of travel; without noise and gaps."""
    times_s, path_base_m, speed_m_s, heading_rad, profile = walk_path(rng, walker, route)
    gait = walk_motion(rng, walker, times_s, speed_m_s)

    def position_base_m(ahead_m: FloatArray, left_m: FloatArray, height_m: float) -> FloatArray:
        xy_m = path_base_m + rotated(np.column_stack([ahead_m, left_m]), heading_rad)
        return np.column_stack([xy_m, height_m - SENSOR_HEIGHT_M + gait.up_m])

    # Head and pelvis turn before the path does: by more, the sharper the turn (Bernardin 2012). On the walks
    # the head's lead is about half as long in turns of 60 deg, and the pelvis's is zero.
    turn_deg = abs(np.degrees(profile.turn_rad))
    head_lead_s = walker.head_lead_s * np.clip((turn_deg - 20.0) / 70.0, 0.0, 1.0)
    sharpness = np.clip((turn_deg - 60.0) / 30.0, 0.0, 1.0)
    pelvis_lead_s = walker.pelvis_lead_s * sharpness
    # The head also turns faster than the body in sharp turns (peak rate 0.9-1.6 times the pelvis's on the
    # walks), so that it points 15-38 deg farther into the turn at a lead of 200 ms.
    head_turn_share = 1.0 - rng.uniform(*_HEAD_TURN_SHORTENING) * sharpness
    head_turn = replace(profile, duration_s=head_turn_share * profile.duration_s)
    wander_rad = walker.head_yaw_wander_rad * slow_variation(rng, times_s, _HIGHEST_WANDER_HZ)
    drift_rad = heading_rad - profile.heading_rad(times_s)
    head_yaw_rad = head_turn.heading_rad(times_s + head_lead_s) + drift_rad
    head_yaw_rad += walker.head_yaw_offset_rad + wander_rad
    pelvis_yaw_rad = profile.heading_rad(times_s + pelvis_lead_s) + drift_rad + gait.pelvis_yaw_rad
    pitch_rad = walker.head_pitch_rad + PITCH_WANDER_RAD * slow_variation(rng, times_s, _HIGHEST_WANDER_HZ)
    roll_rad = ROLL_WANDER_RAD * slow_variation(rng, times_s, _HIGHEST_WANDER_HZ)

    pelvis_height_m = PELVIS_HEIGHT_RATIO * walker.head_height_m
    lean_rad = _LEAN_RATIO * speed_m_s * profile.rate_rad_s(times_s) / _GRAVITY_M_S2
    lean_left_m = lean_rad * (walker.head_height_m - pelvis_height_m)
    return times_s, Track(
        head_position_m=position_base_m(
            walker.head_ahead_m + gait.ahead_m, gait.head_left_m + lean_left_m, walker.head_height_m
        ),
        head_quat_wxyz=quat_wxyz(head_yaw_rad, pitch_rad + gait.head_pitch_rad, roll_rad + gait.head_roll_rad),
        pelvis_position_m=position_base_m(gait.ahead_m, gait.pelvis_left_m, pelvis_height_m),
        pelvis_quat_wxyz=quat_wxyz(pelvis_yaw_rad),
    )


def quat_wxyz(yaw_rad: FloatArray, pitch_rad: ArrayLike = 0.0, roll_rad: ArrayLike = 0.0) -> FloatArray:
    """Quaternions, shape (N, 4), from yaw (left), then pitch (nose down), then roll (to the right ear)."""
    angles_rad = np.column_stack(np.broadcast_arrays(yaw_rad, pitch_rad, roll_rad))
    return np.asarray(Rotation.from_euler("ZYX", angles_rad).as_quat(scalar_first=True))


def rotated(offset_m: FloatArray, yaw_rad: ArrayLike) -> FloatArray:
    """Offsets ahead and to the left, shape (N, 2), in the base frame; the yaw has shape (N,) or is one for all."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    ahead_m, left_m = offset_m.T
    return np.column_stack([ahead_m * cos - left_m * sin, ahead_m * sin + left_m * cos])


def measured_track(rng: np.random.Generator, truth: Track) -> Track:
    """Measurements of a person by a body tracker in the origin of the frame: noise, bias and missing frames."""
    bias_m = rng.uniform(-_DEPTH_BIAS_M, _DEPTH_BIAS_M)
    seen = rng.uniform(size=(len(truth.head_position_m), 1)) >= _MISSING_SHARE
    head, pelvis = (truth.head_position_m, truth.head_quat_wxyz), (truth.pelvis_position_m, truth.pelvis_quat_wxyz)
    parts: list[FloatArray] = []
    for position_m, quat_wxyz in (head, pelvis):
        # Noise and bias along the ray from the sensor, and less noise across it.
        distance_m = np.linalg.norm(position_m, axis=1, keepdims=True)
        ray = position_m / distance_m
        depth_sd_m = _DEPTH_NOISE_M * np.minimum(distance_m / _DEPTH_NOISE_DISTANCE_M, 1.0)
        across = rng.normal(size=position_m.shape)
        across -= (across * ray).sum(axis=1, keepdims=True) * ray
        along = rng.normal(size=distance_m.shape)
        noisy_m = position_m + (bias_m + depth_sd_m * along) * ray + _LATERAL_NOISE_RATIO * depth_sd_m * across
        noisy_wxyz = turned(quat_wxyz, _YAW_NOISE_RAD * rng.normal(size=len(quat_wxyz)))
        parts += [np.where(seen, noisy_m, np.nan), np.where(seen, noisy_wxyz, np.nan)]
    return Track(*parts)
