"""Synthetic walks before the robot: 14 people on 6 routes, after the paper's experiment.

The walks are made from their names alone, out of published figures for human locomotion, so that all experiments run
without recordings of people. They do not replace recordings of people: results hold for this model's motion only.

The origin of the frame is the robot's sensor and the axis of its neck's pan, 1.2 m above the floor; x is
forward, y left, z up.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.recordings.recording import Labels, Recording, Track, turned
from gazempc.recordings.synthetic.gait import (
    PELVIS_HEIGHT_RATIO,
    WalkerTraits,
    draw_walkers,
    slow_variation,
    walk_motion,
)
from gazempc.recordings.synthetic.routes import ROUTES, TravelPath, walk_path
from gazempc.types import BoolArray, FloatArray

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
    people_rng = np.random.default_rng(DATASET_SEED)
    motion_rng = np.random.default_rng([DATASET_SEED, number, route_number, 1])
    noise_rng = np.random.default_rng([DATASET_SEED, number, route_number, 2])

    walker = draw_walkers(people_rng, SUBJECTS)[number - 1]
    path = walk_path(motion_rng, walker, route)
    truth = _true_track(motion_rng, walker, path)
    description = f"synthetic walk, route {route_name}: {route.description}"
    return synthetic(name, path.times_s, truth, noise_rng, Labels(subject, route.group, description))


def synthetic(
    name: str, times_s: FloatArray, truth: Track, noise_rng: np.random.Generator, labels: Labels
) -> Recording:
    """A recording of exact truth, with simulated measurements of a body tracker at the origin of the frame."""
    measured = measured_track(noise_rng, truth)
    return Recording(name, "synthetic", "synthetic", times_s, truth, measured, has_robot=True, labels=labels)


def _true_track(rng: np.random.Generator, walker: WalkerTraits, path: TravelPath) -> Track:
    """Add gait, anticipation and gaze to the path of travel; without noise and gaps."""
    times_s = path.times_s
    gait = walk_motion(rng, walker, times_s, path.speed_m_s)
    cos, sin = np.cos(path.heading_rad), np.sin(path.heading_rad)

    def position_base_m(ahead_m: FloatArray, left_m: FloatArray, height_m: float) -> FloatArray:
        x = path.position_base_m[:, 0] + ahead_m * cos - left_m * sin
        y = path.position_base_m[:, 1] + ahead_m * sin + left_m * cos
        return np.stack([x, y, height_m - SENSOR_HEIGHT_M + gait.up_m], axis=-1)

    # Head and pelvis turn before the path does: by more, the sharper the turn (Bernardin 2012). On the walks
    # the head's lead is about half as long in turns of 60 deg, and the pelvis's is zero.
    turn_deg = abs(np.degrees(path.profile.turn_rad))
    head_lead_s = walker.head_lead_s * np.clip((turn_deg - 20.0) / 70.0, 0.0, 1.0)
    sharpness = np.clip((turn_deg - 60.0) / 30.0, 0.0, 1.0)
    pelvis_lead_s = walker.pelvis_lead_s * sharpness
    # The head also turns faster than the body in sharp turns (peak rate 0.9-1.6 times the pelvis's on the
    # walks), so that it points 15-38 deg farther into the turn at a lead of 200 ms.
    head_turn_share = 1.0 - rng.uniform(*_HEAD_TURN_SHORTENING) * sharpness
    head_turn = replace(path.profile, duration_s=head_turn_share * path.profile.duration_s)
    wander_rad = walker.head_yaw_wander_rad * slow_variation(rng, times_s, _HIGHEST_WANDER_HZ)
    drift_rad = path.heading_rad - path.profile.heading_rad(times_s)
    head_yaw_rad = head_turn.heading_rad(times_s + head_lead_s) + drift_rad
    head_yaw_rad += walker.head_yaw_offset_rad + wander_rad
    pelvis_yaw_rad = path.profile.heading_rad(times_s + pelvis_lead_s) + drift_rad + gait.pelvis_yaw_rad
    pitch_rad = walker.head_pitch_rad + PITCH_WANDER_RAD * slow_variation(rng, times_s, _HIGHEST_WANDER_HZ)
    roll_rad = ROLL_WANDER_RAD * slow_variation(rng, times_s, _HIGHEST_WANDER_HZ)
    level = np.zeros_like(times_s)

    pelvis_height_m = PELVIS_HEIGHT_RATIO * walker.head_height_m
    lean_rad = _LEAN_RATIO * path.speed_m_s * path.profile.rate_rad_s(times_s) / _GRAVITY_M_S2
    lean_left_m = lean_rad * (walker.head_height_m - pelvis_height_m)
    return Track(
        head_position_m=position_base_m(
            walker.head_ahead_m + gait.ahead_m, gait.head_left_m + lean_left_m, walker.head_height_m
        ),
        head_quat_wxyz=quat_wxyz(head_yaw_rad, pitch_rad + gait.head_pitch_rad, roll_rad + gait.head_roll_rad),
        pelvis_position_m=position_base_m(gait.ahead_m, gait.pelvis_left_m, pelvis_height_m),
        pelvis_quat_wxyz=quat_wxyz(pelvis_yaw_rad, level, level),
    )


def quat_wxyz(yaw_rad: FloatArray, pitch_rad: FloatArray, roll_rad: FloatArray) -> FloatArray:
    """Quaternions, shape (N, 4), from yaw (left), then pitch (nose down), then roll (to the right ear)."""
    angles_rad = np.stack([yaw_rad, pitch_rad, roll_rad], axis=-1)
    return np.asarray(Rotation.from_euler("ZYX", angles_rad).as_quat(scalar_first=True))


def measured_track(rng: np.random.Generator, truth: Track) -> Track:
    """Measurements of a person by a body tracker in the origin of the frame: noise, bias and missing frames."""
    bias_m = rng.uniform(-_DEPTH_BIAS_M, _DEPTH_BIAS_M)
    valid = rng.uniform(size=len(truth.head_position_m)) >= _MISSING_SHARE
    return Track(
        head_position_m=_seen_position_m(rng, truth.head_position_m, bias_m, valid),
        head_quat_wxyz=_seen_quat_wxyz(rng, truth.head_quat_wxyz, valid),
        pelvis_position_m=_seen_position_m(rng, truth.pelvis_position_m, bias_m, valid),
        pelvis_quat_wxyz=_seen_quat_wxyz(rng, truth.pelvis_quat_wxyz, valid),
    )


def _seen_position_m(rng: np.random.Generator, position_m: FloatArray, bias_m: float, valid: BoolArray) -> FloatArray:
    """Add noise and bias along the ray from the sensor and less noise across it; shape (N, 3)."""
    distance_m = np.linalg.norm(position_m, axis=1, keepdims=True)
    ray = position_m / distance_m
    depth_sd_m = _DEPTH_NOISE_M * np.minimum(distance_m / _DEPTH_NOISE_DISTANCE_M, 1.0)
    across = rng.normal(size=position_m.shape)
    across -= (across * ray).sum(axis=1, keepdims=True) * ray
    along = rng.normal(size=distance_m.shape)
    seen_m = position_m + (bias_m + depth_sd_m * along) * ray + _LATERAL_NOISE_RATIO * depth_sd_m * across
    return np.where(valid[:, None], seen_m, np.nan)


def _seen_quat_wxyz(rng: np.random.Generator, quat_wxyz: FloatArray, valid: BoolArray) -> FloatArray:
    """Turn orientations, shape (N, 4), about the vertical by the noise of the yaw."""
    noise_rad = _YAW_NOISE_RAD * rng.normal(size=len(quat_wxyz))
    return np.where(valid[:, None], turned(quat_wxyz, noise_rad), np.nan)
