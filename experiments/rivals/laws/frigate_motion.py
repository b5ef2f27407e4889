"""How Frigate sees a person move: a Kalman filter on two corners of the box, and which velocities it believes."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter

from gazempc.types import FloatArray

# Constants of Frigate, `track/norfair_tracker.py` and `ptz/autotrack.py`: of a person; pixels and frames.
_R, _Q = 4.5, 0.25
_LARGEST_DIFFERENCE_PX = 20.0
_LARGEST_DEVIATION_PX = 10.0
_LIKE_DIFFERENCE_PX = 10.0
_LEAST_COSINE, _LEAST_COSINE_ALIKE = 0.93, 0.6
# Of a velocity that is not yet known (norfair's default).
_START_P = 10.0


class CornerFilter:
    """Position and velocity of two corners, each coordinate by itself: they move on with random changes of speed.

    Args:
        corners_px: Upper left and lower right corner in the first frame, shape (2, 2), pixels.
    """

    def __init__(self, corners_px: FloatArray) -> None:
        kalman = KalmanFilter(dim_x=8, dim_z=4)
        kalman.x[:4, 0] = corners_px.ravel()
        kalman.F[:4, 4:] = np.eye(4)
        kalman.H[:, :4] = np.eye(4)
        kalman.P[4:, 4:] *= _START_P
        kalman.Q[4:, 4:] *= _Q
        kalman.R *= _R
        self._kalman = kalman

    def update(self, corners_px: FloatArray) -> FloatArray:
        """Velocity of both corners with the corners of the next frame, shape (2, 2), pixels a frame."""
        self._kalman.predict()
        self._kalman.update(corners_px.ravel())
        velocity: FloatArray = self._kalman.x[4:, 0].reshape(2, 2).copy()
        return velocity


def believed_velocity(corners_px: FloatArray, image_px: FloatArray, fps: float) -> FloatArray | None:
    """The box's velocity, if its corners agree on it.

    Args:
        corners_px: Velocity of both corners, shape (2, 2), pixels a frame.
        image_px: Width and height of the image, shape (2,), pixels.
        fps: Frames a second.

    Returns:
        Their mean, shape (2,), pixels a frame; None if they are too fast or too different.
    """
    first, second = corners_px
    difference = np.abs(first - second)
    sizes = np.linalg.norm(corners_px, axis=1)
    cosine = float(first @ second) / sizes.prod() if sizes.all() else 1.0
    alike = (difference < _LIKE_DIFFERENCE_PX).all()
    valid = (
        (np.abs(corners_px) <= image_px / (2.0 * fps)).all()
        and (difference <= _LARGEST_DIFFERENCE_PX).all()
        and (corners_px.std(axis=0) <= _LARGEST_DEVIATION_PX).all()
        and cosine >= (_LEAST_COSINE_ALIKE if alike else _LEAST_COSINE)
    )
    return corners_px.mean(axis=0) if valid else None
