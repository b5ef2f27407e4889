"""Synthetic people before the robot who mostly stand: 14 people x 5 activities, as in everyday human-robot interaction.

People, gait, camera and noise are as for the synthetic walks. Each recording is a function of its name only. Figures
without a source are marked "assumed": they are of the order of what motion capture of people who signal and direct
traffic shows, whose heads move within 5 to 18 cm, and within 60 cm while turning.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from gazempc.recordings.recording import Labels, Recording, Track
from gazempc.recordings.synthetic.gait import (
    PELVIS_HEIGHT_RATIO,
    WalkerTraits,
    bounded_normal,
    draw_walkers,
    slow_variation,
    step_rate_hz,
    walk_motion,
)
from gazempc.recordings.synthetic.walks import (
    DATASET_SEED,
    FRAME_RATE_HZ,
    MINIMUM_JERK_PEAK,
    PITCH_WANDER_RAD,
    ROLL_WANDER_RAD,
    SENSOR_HEIGHT_M,
    SUBJECTS,
    HeadingProfile,
    place_in_view,
    quat_wxyz,
    rotated,
    synthetic,
)
from gazempc.types import FloatArray

_DURATION_S = (8.0, 10.0)
_DISTANCE_M = (1.2, 3.6)  # social distance: Hall 1966
_BEARING_RAD = np.radians(20.0)  # within the camera's view with room for leans; our choice
_FACING_RAD = np.radians(25.0)  # of the body off the robot; assumed

# In quiet standing the body is an inverted pendulum about the ankles, whose sway has its power below 1 Hz (Winter
# 1995). Standard deviations at the head: assumed, more fore and aft than to the side.
_SWAY_M = (0.007, 0.004)
_SWAY_HZ = 0.8
# Shifts, fidgets and drifts are the patterns of unconstrained standing (Duarte & Zatsiorsky 1999); sizes, durations
# and pauses are assumed.
_SHIFT_M = (0.02, 0.06)
_SHIFT_LASTS_S = (0.8, 1.8)
_FIDGET_M = (0.01, 0.04)
_FIDGET_LASTS_S = (0.8, 1.6)
_DRIFT_M = 0.010
_DRIFT_HZ = 0.15
_PAUSE_S = (1.5, 4.0)
_LOOK_ABOUT_RAD = np.radians(6.0)  # s.d. of the yaw of a head that is free to look about; assumed
_LOOK_ABOUT_HZ = 0.6

# Gestures of the arms move the trunk: leans at the hip, turns of head and pelvis; all assumed.
_GESTURE_LASTS_S = (0.7, 1.6)
_GESTURE_PAUSE_S = (0.1, 1.2)
_LEAN_M = (0.03, 0.11)
_GESTURE_HEAD_RAD = np.radians((5.0, 30.0))
_GESTURE_PELVIS_SHARE = 0.3  # of the head's turn

# Turns on the spot: the head begins, the pelvis follows (Hollands et al. 2004); angles, rates and pauses assumed.
_TURN_RAD = np.radians((60.0, 180.0))
_TURN_PEAK_RAD_S = np.radians((90.0, 170.0))
_TURN_PAUSE_S = (0.6, 1.5)
_TURN_RADIUS_M = 0.20  # of the steps about the foot turned on; assumed

# Steady walking is reached, and left, within two to three steps (Breniere & Do 1986; Jian et al. 1993).
_STEPS = (2.0, 3.0)
_TO_HEADING_S = 1.5  # to turn from the robot to the direction of travel; assumed
_WALK_S = (3.5, 4.5)
_LONGEST_WALK_M = 3.4  # longest path within the view in most directions
_WALK_HEADING_RAD = np.radians((60.0, 150.0))  # to either side of "away from the robot"; our choice


# Labels of the activities; the subject is that of the recording.
ACTIVITIES = {
    "stand": Labels("", "standing", "stands and sways", "standing"),
    "gesture": Labels("", "standing", "stands and gestures", "gesturing"),
    "turn_on_spot": Labels("", "standing", "turns on the spot", "turning on the spot"),
    "start": Labels("", "straight", "stands, then walks off", "starting"),
    "stop": Labels("", "straight", "walks, then stands", "stopping"),
}


def everyday_names() -> tuple[str, ...]:
    """Names of all 70 recordings, ``subject01_stand`` to ``subject14_stop``."""
    return tuple(f"subject{number:02}_{activity}" for number in range(1, SUBJECTS + 1) for activity in ACTIVITIES)


def generate_everyday(name: str) -> Recording:
    """Generate one recording of a person who stands, starts or stops; deterministic in its name.

    Args:
        name: One of `everyday_names`.

    Returns:
        The person with exact truth and simulated measurements of a body tracker.
    """
    subject, _, activity = name.partition("_")
    number = int(subject.removeprefix("subject"))
    # The routes of the walks are 1 to 6.
    stream = [DATASET_SEED, number, 11 + list(ACTIVITIES).index(activity)]
    walker = draw_walkers(np.random.default_rng(DATASET_SEED), SUBJECTS)[number - 1]
    times_s, truth = _true_track(np.random.default_rng([*stream, 1]), walker, activity)
    about = ACTIVITIES[activity]
    labels = replace(about, subject=subject, description=f"synthetic, {about.description}")
    return synthetic(name, times_s, truth, np.random.default_rng([*stream, 2]), labels)


def _true_track(rng: np.random.Generator, walker: WalkerTraits, activity: str) -> tuple[FloatArray, Track]:
    times_s = np.arange(round(rng.uniform(*_DURATION_S) * FRAME_RATE_HZ)) / FRAME_RATE_HZ
    speed_m_s, step_s, heading_rad = np.zeros_like(times_s), 0.0, 0.0
    if activity in ("start", "stop"):
        speed_m_s, step_s = _speed(rng, walker, times_s, activity)
        walked_m = np.column_stack([cumulative_trapezoid(speed_m_s, times_s, initial=0), np.zeros_like(times_s)])
        wanted_rad = rng.choice([-1.0, 1.0]) * rng.uniform(*_WALK_HEADING_RAD)
        middle_m = np.array([rng.uniform(2.8, 3.4), 0.0])
        centred_m = walked_m - 0.5 * (walked_m[0] + walked_m[-1])
        heading_rad, middle_m = place_in_view(centred_m, wanted_rad, middle_m)
        base_m = middle_m + centred_m[:, :1] * np.array([np.cos(heading_rad), np.sin(heading_rad)])
    else:
        distance_m, bearing_rad = rng.uniform(*_DISTANCE_M), rng.uniform(-_BEARING_RAD, _BEARING_RAD)
        base_m = np.tile(distance_m * np.array([np.cos(bearing_rad), np.sin(bearing_rad)]), (times_s.size, 1))

    # People who stand face the robot more or less; people who walk turn to the direction of travel in the first steps,
    # and away from it during the last.
    stands_m = base_m[-1] if activity == "stop" else base_m[0]
    facing_rad = np.arctan2(-stands_m[1], -stands_m[0]) + rng.uniform(-_FACING_RAD, _FACING_RAD)
    turns: list[HeadingProfile] = []
    if activity in ("start", "stop"):
        aside_rad = (heading_rad - facing_rad + np.pi) % (2.0 * np.pi) - np.pi
        turns = [HeadingProfile(0.0, aside_rad if activity == "start" else -aside_rad, step_s, _TO_HEADING_S)]
        facing_rad += aside_rad if activity == "stop" else 0.0
    elif activity == "turn_on_spot":
        turns = _turns(rng, times_s)

    def turned_rad(ahead_s: float) -> FloatArray:
        return sum((turn.heading_rad(times_s + ahead_s) for turn in turns), np.full_like(times_s, facing_rad))

    body_rad = turned_rad(walker.pelvis_lead_s)
    if activity == "turn_on_spot":
        # The body steps round one foot, and back the same way.
        arc_m_s = rng.choice([-1.0, 1.0]) * _TURN_RADIUS_M * np.gradient(body_rad, times_s)
        velocity_m_s = arc_m_s[:, None] * np.column_stack([np.cos(body_rad), np.sin(body_rad)])
        base_m = base_m + cumulative_trapezoid(velocity_m_s, times_s, axis=0, initial=0)

    walking = speed_m_s / max(float(speed_m_s.max()), 1e-9)
    gait = walk_motion(rng, walker, times_s, speed_m_s)
    sway_m = (1.0 - walking)[:, None] * _standing_sway(rng, times_s)
    nothing = np.zeros((times_s.size, 2)), np.zeros_like(times_s)
    lean_m, gesture_rad = _gestures(rng, times_s) if activity == "gesture" else nothing
    along_rad = np.where(walking > 0.0, heading_rad, body_rad)

    def position_base_m(body_m: FloatArray, gait_left_m: FloatArray, height_m: float) -> FloatArray:
        """Positions from offsets ahead and to the left of the body, and the gait's about the direction of travel."""
        gait_m = walking[:, None] * np.column_stack([gait.ahead_m, gait_left_m])
        xy_m = base_m + rotated(body_m, body_rad) + rotated(gait_m, along_rad)
        return np.column_stack([xy_m, height_m - SENSOR_HEIGHT_M + walking * gait.up_m])

    look_rad = walker.head_yaw_wander_rad * walking + _LOOK_ABOUT_RAD * (1.0 - walking)
    head_yaw_rad = turned_rad(walker.pelvis_lead_s + walker.head_lead_s) + walker.head_yaw_offset_rad + gesture_rad
    head_yaw_rad += look_rad * slow_variation(rng, times_s, _LOOK_ABOUT_HZ)
    pitch_rad = walker.head_pitch_rad + PITCH_WANDER_RAD * slow_variation(rng, times_s, _LOOK_ABOUT_HZ)
    roll_rad = ROLL_WANDER_RAD * slow_variation(rng, times_s, _LOOK_ABOUT_HZ)
    pelvis_yaw_rad = body_rad + _GESTURE_PELVIS_SHARE * gesture_rad + walking * gait.pelvis_yaw_rad
    return times_s, Track(
        head_position_m=position_base_m(
            sway_m + lean_m + [walker.head_ahead_m, 0.0], gait.head_left_m, walker.head_height_m
        ),
        head_quat_wxyz=quat_wxyz(
            head_yaw_rad, pitch_rad + walking * gait.head_pitch_rad, roll_rad + walking * gait.head_roll_rad
        ),
        # About the ankles the pelvis sways less, by its height.
        pelvis_position_m=position_base_m(
            PELVIS_HEIGHT_RATIO * sway_m, gait.pelvis_left_m, PELVIS_HEIGHT_RATIO * walker.head_height_m
        ),
        pelvis_quat_wxyz=quat_wxyz(pelvis_yaw_rad),
    )


def _speed(
    rng: np.random.Generator, walker: WalkerTraits, times_s: FloatArray, activity: str
) -> tuple[FloatArray, float]:
    """Speed of travel, shape (N,), and the middle of the first or last steps, seconds."""
    cruise_m_s = walker.speed_m_s * bounded_normal(rng, 1.0, 0.03, 0.94, 1.04)
    ramp_s = rng.uniform(*_STEPS) / float(step_rate_hz(walker, np.array(cruise_m_s)))
    walk_s = min(rng.uniform(*_WALK_S), _LONGEST_WALK_M / cruise_m_s + 0.5 * ramp_s)
    wander = 1.0 + 0.03 * slow_variation(rng, times_s, 0.4)  # as on the synthetic walks
    middle_s = walk_s - 0.5 * ramp_s
    walking = 1.0 - HeadingProfile(0.0, 1.0, middle_s, ramp_s).heading_rad(times_s)
    if activity == "start":  # a stop, played backwards
        return (cruise_m_s * wander * walking)[::-1], float(times_s[-1]) - middle_s
    return cruise_m_s * wander * walking, middle_s


def _moments(
    rng: np.random.Generator, times_s: FloatArray, lasts_s: tuple[float, float], pause_s: tuple[float, float]
) -> list[HeadingProfile]:
    """Consecutive movements of size 1 with pauses."""
    found, from_s = [], rng.uniform(0.0, pause_s[1])
    while from_s < times_s[-1]:
        length_s = rng.uniform(*lasts_s)
        found.append(HeadingProfile(0.0, 1.0, from_s + 0.5 * length_s, length_s))
        from_s += length_s + rng.uniform(*pause_s)
    return found


def _standing_sway(rng: np.random.Generator, times_s: FloatArray) -> FloatArray:
    """Sway, drift, shifts of weight and fidgets of the head, ahead and to the left, shape (N, 2), metres."""
    sway_m = np.column_stack([sd_m * slow_variation(rng, times_s, _SWAY_HZ) for sd_m in _SWAY_M])
    sway_m += _DRIFT_M * np.column_stack([slow_variation(rng, times_s, _DRIFT_HZ) for _ in _SWAY_M])
    side = rng.choice([-1.0, 1.0])
    for shift in _moments(rng, times_s, _SHIFT_LASTS_S, _PAUSE_S):
        # From one leg to the other, alternating.
        sway_m[:, 1] += side * rng.uniform(*_SHIFT_M) * shift.heading_rad(times_s)
        side = -side
    for fidget in _moments(rng, times_s, _FIDGET_LASTS_S, _PAUSE_S):
        angle_rad = rng.uniform(-np.pi, np.pi)
        size_m = rng.uniform(*_FIDGET_M) * np.array([np.cos(angle_rad), np.sin(angle_rad)])
        sway_m += fidget.rate_shape(times_s)[:, None] * size_m
    return sway_m


def _gestures(rng: np.random.Generator, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Leans of the head, ahead and to the left, shape (N, 2), metres, and its turns, shape (N,), radians."""
    lean_m, turn_rad = np.zeros((times_s.size, 2)), np.zeros_like(times_s)
    for gesture in _moments(rng, times_s, _GESTURE_LASTS_S, _GESTURE_PAUSE_S):
        angle_rad = rng.uniform(-0.5 * np.pi, 0.5 * np.pi)  # people bend forward and aside, hardly back
        size_m = rng.uniform(*_LEAN_M) * np.array([np.cos(angle_rad), np.sin(angle_rad)])
        shape = gesture.rate_shape(times_s)
        lean_m += shape[:, None] * size_m
        turn_rad += np.sign(angle_rad) * rng.uniform(*_GESTURE_HEAD_RAD) * shape
    return lean_m, turn_rad


def _turns(rng: np.random.Generator, times_s: FloatArray) -> list[HeadingProfile]:
    """Turns there and back, until the end of the recording."""
    found: list[HeadingProfile] = []
    from_s, side = rng.uniform(*_TURN_PAUSE_S), rng.choice([-1.0, 1.0])
    while from_s < times_s[-1]:
        angle_rad = -found[-1].turn_rad if len(found) % 2 else side * rng.uniform(*_TURN_RAD)
        lasts_s = MINIMUM_JERK_PEAK * abs(angle_rad) / rng.uniform(*_TURN_PEAK_RAD_S)
        found.append(HeadingProfile(0.0, angle_rad, from_s + 0.5 * lasts_s, lasts_s))
        from_s += lasts_s + rng.uniform(*_TURN_PAUSE_S)
    return found
