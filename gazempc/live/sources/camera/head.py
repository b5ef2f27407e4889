"""Pose estimation of a head from the key points of its face."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gazempc.types import FloatArray
from predictors import HeadObservation
from predictors.geometry import bearing_covariance

# Mean adult, metres from the point between the eyes: x to the front, y to the person's left, z up. Pupils: 63 mm apart
# (Dodgson 2004). Ears (tragion): 140 mm apart (ANSUR II, mean of women and men). Other values are rounded.
_FACE_M = np.array(
    [
        [0.0, -0.0315, 0.0],  # right eye
        [0.0, 0.0315, 0.0],
        [0.022, 0.0, -0.036],  # tip of the nose
        [0.004, 0.0, -0.070],  # mouth
        [-0.085, -0.070, -0.022],  # right ear
        [-0.085, 0.070, -0.022],
    ]
)
# Standard deviation of face shape at each point, apart from size. The network locates ears less accurately.
_SHAPE_SD_M = np.array([0.003, 0.003, 0.006, 0.006, 0.012, 0.012])
# Standard deviation of the network's points, as a share of the side of its input square.
POINT_SD = 0.01
# Below this score, such as of faces turned away by 60 degrees, the error grows: at 0.4 it is twice as large.
_SURE_SCORE = 0.7
# Sizes of adults' heads (standard deviation of the distance between the pupils: 6 %; Dodgson 2004), and children.
_SIZE_SD = 0.10
# Prior of head rotation: mostly upright; faces turned farther are not detected.
_YAW_SD_RAD, _PITCH_SD_RAD, _ROLL_SD_RAD = math.radians(35.0), math.radians(12.0), math.radians(12.0)
# Bearing error from the face's geometry: the point between the eyes is no landmark.
_BEARING_SD_M = 0.004
_BEARING_SD_RAD = math.radians(0.08)
# Maximum standard deviation of a useful yaw.
_YAW_SD_MAX_RAD = math.radians(20.0)


def head_from_points(
    rays: FloatArray, point_sd: float, score: float = 1.0, time_s: float = 0.0, person_id: str | None = None
) -> HeadObservation:
    """Fit the mean face to the key points of a face.

    Maximum a posteriori pose by nonlinear least squares: reprojection errors plus a prior of head poses and sizes.

    Args:
        rays: Normalised image coordinates of the key points, positive left and up, shape (6, 2).
        point_sd: Standard deviation of the network's errors, as a tangent.
        score: Confidence of the detection.
        time_s: Capture time of the picture, seconds.
        person_id: Name of the person.

    Returns:
        The point between the eyes in the camera's frame (x along the view, y left, z up), with a covariance that is
        long along the line of sight; its orientation where the face shows it.
    """
    eyes = rays[:2].mean(axis=0)
    # Initial range from the apparent size of the mean face.
    range_m = math.sqrt(_FACE_M[:, 1:].var(axis=0).sum() / rays.var(axis=0).sum())
    towards_rad = math.atan(eyes[0])
    doubt = max(1.0, _SURE_SCORE / score)

    def errors(pose: FloatArray) -> FloatArray:
        left, up, log_range, yaw, pitch, roll = pose
        depth_m = range_m * math.exp(log_range)
        turn = Rotation.from_euler("ZYX", [math.pi + towards_rad + yaw, pitch, roll])
        points = turn.apply(_FACE_M) + depth_m * np.array([1.0, left, up])
        seen = points[:, 1:] / points[:, :1]
        sd = doubt * np.hypot(point_sd, _SHAPE_SD_M / depth_m)
        likely = [yaw / _YAW_SD_RAD, pitch / _PITCH_SD_RAD, roll / _ROLL_SD_RAD]
        return np.concatenate([((seen - rays) / sd[:, None]).ravel(), likely])

    found = least_squares(errors, np.array([*eyes, 0.0, 0.0, 0.0, 0.0]), method="lm", x_scale="jac")
    left, up, log_range, yaw, pitch, roll = found.x
    slope = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.inv(slope.T @ slope)
    position_m = range_m * math.exp(log_range) * np.array([1.0, left, up])
    away_m = float(np.linalg.norm(position_m))
    bearing_sd_rad = math.sqrt(
        max(covariance[0, 0], covariance[1, 1]) + _BEARING_SD_RAD**2 + (_BEARING_SD_M / away_m) ** 2
    )
    range_sd_m = away_m * math.hypot(math.sqrt(covariance[2, 2]), _SIZE_SD)
    yaw_sd_rad = math.sqrt(covariance[3, 3])
    shown = yaw_sd_rad < _YAW_SD_MAX_RAD
    turn = Rotation.from_euler("ZYX", [math.pi + towards_rad + yaw, pitch, roll])
    return HeadObservation(
        time_s,
        position_m,
        head_quat_wxyz=turn.as_quat(scalar_first=True) if shown else None,
        position_covariance_m2=bearing_covariance(position_m, bearing_sd_rad, range_sd_m),
        head_yaw_sd_rad=yaw_sd_rad if shown else None,
        person_id=person_id,
        confidence=score,
    )
