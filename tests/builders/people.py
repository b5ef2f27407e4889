"""Observations of walking people, for predictors."""

from functools import partial

import numpy as np
from scipy.linalg import block_diag

from predictors import (
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    HeadObservation,
    HeadPose,
    InteractingModels,
    LastPosition,
    ParticleFilter,
    PelvisPursuit,
)

PREDICTORS = {
    "last": LastPosition,
    "cv": ConstantVelocity,
    "ca": ConstantAcceleration,
    "ctrv": CoordinatedTurn,
    "ctrv with yaw": partial(CoordinatedTurn, yaw_cues="both"),
    "imm": InteractingModels,
    "particle": ParticleFilter,
    "head": partial(HeadPose, weight=0.7),
    "pursuit": PelvisPursuit,
}
FRAME_S = 1.0 / 30.0
WALK_M_S = np.array([1.1, -0.4, 0.05])


def yaw_quat(yaw):
    return np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])


def seen(time_s, position_m, head_yaw=None, waist_yaw=0.0):
    if head_yaw is None:
        return HeadObservation(time_s, position_m)
    return HeadObservation(time_s, position_m, yaw_quat(head_yaw), yaw_quat(waist_yaw))


def walk(predictor, frames=30, relative_yaw=None, noise_m=0.005):
    """Update a predictor with a straight walk; returns the time of the last frame."""
    rng = np.random.default_rng(3)
    for i in range(frames):
        position = np.array([2.0, 1.0, 0.4]) + i * FRAME_S * WALK_M_S + noise_m * rng.standard_normal(3)
        head = None if relative_yaw is None else relative_yaw + 0.3
        predictor.update(seen(i * FRAME_S, position, head, waist_yaw=0.3))
    return (frames - 1) * FRAME_S


def turned_walk(predictor, frames, angle=np.pi / 9, speed=1.2, start_s=0.0, start_m=(2.0, 1.0, 0.4), waist_yaw=None):
    """A noise-free straight walk at heading 0.3 rad with constant head yaw; returns the last time."""
    direction = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    for i in range(frames):
        head, waist = yaw_quat(0.3 + angle), None if waist_yaw is None else yaw_quat(waist_yaw)
        position = np.array(start_m) + i * FRAME_S * speed * direction
        predictor.update(HeadObservation(start_s + i * FRAME_S, position, head, waist))
    return start_s + (frames - 1) * FRAME_S


def velocity_kernel(psd):
    """Covariance of an axis at two times (their product, earlier, later): speed 0 +- 1 m/s, white acceleration."""
    return lambda product, early, late: product + psd * (early**2 * late / 2 - early**3 / 6)


def posterior(observations, times_s, kernel, noise_m=0.0):
    """Posterior means and covariances by one dense solve of the joint Gaussian of all positions.

    As in the filters, the first observation is the prior mean, with its covariance as the prior's. Without a stated
    covariance, the noise is `noise_m` on each axis.
    """
    n, seen_m = len(observations), np.array([o.head_position_base_m for o in observations])
    stated = [noise_m**2 * np.eye(3) if o.position_covariance_m2 is None else o.position_covariance_m2
              for o in observations]  # fmt: skip
    t = np.concatenate([[o.capture_time_s for o in observations], times_s])
    t = t - t[0]
    joint = np.kron(kernel(np.outer(t, t), np.minimum.outer(t, t), np.maximum.outer(t, t)), np.eye(3))
    joint = joint + np.tile(stated[0], (t.size, t.size))
    seen, later = slice(3, 3 * n), slice(3 * n, None)
    gain = np.linalg.solve(joint[seen, seen] + block_diag(*stated[1:]), joint[seen, later]).T
    means_m = np.tile(seen_m[0], len(times_s)) + gain @ (seen_m[1:] - seen_m[0]).ravel()
    spread = (joint[later, later] - gain @ joint[seen, later]).reshape(len(times_s), 3, -1, 3)
    return means_m.reshape(-1, 3), np.array([spread[k, :, k] for k in range(len(times_s))])
