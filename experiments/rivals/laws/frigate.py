"""Frigate's autotracking: one relative move at a time, to the predicted position of the person at its end.

Only frames received after the end of the last move are used, which gives stop-and-go motion. The model of a move's
duration is fitted to thirty moves. The law has no model of the stream's delay: a frame received after the end of a move
may show the scene before it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter

from experiments.rivals.rival import Detection, FrameRate, HeadCamera, Rival, View
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# Constants of Frigate, `ptz/autotrack.py`.
_DEAD_ZONE, _DEAD_ZONE_UNSURE = 0.08, 0.03
_RETURN_S = 10.0
_FPS = 5.0  # frame rate of the detector
# Height of a person in faces. Frigate tracks persons; here the box is centred on the face.
_FACES_TALL = 7.0


@dataclass(frozen=True)
class MoveTime:
    """Duration of a move: ``offset_s * zero_move_s + slope_s * size``, as in the source.

    Attributes:
        offset_s: Intercept of the fit, seconds; the source multiplies it by the duration of a zero move.
        slope_s: Slope of the fit, seconds for half of the field of view.
        zero_move_s: Measured duration of a zero move, seconds.
    """

    offset_s: float
    slope_s: float
    zero_move_s: float

    def predict_s(self, move: FloatArray) -> float:
        """Duration, seconds, of a move, shape (2,), in halves of the field of view."""
        return self.offset_s * self.zero_move_s + self.slope_s * float(np.abs(move).sum())


class Frigate(Rival):
    """Stop-and-go tracking: a move, a wait for its end, a new detection.

    Args:
        neck: Model of the neck, with the range of the moves.
        camera: Model of the camera.
        move_time: Calibrated duration of moves; None without calibration.
        faces_tall: Height of the tracked box in heights of the face.
    """

    name = "frigate"

    def __init__(
        self,
        neck: NeckSpec,
        camera: HeadCamera,
        *,
        move_time: MoveTime | None = None,
        faces_tall: float = _FACES_TALL,
    ) -> None:
        super().__init__(neck, camera)
        self._half_view_rad = np.array([camera.half_width_rad, camera.half_height_rad])
        self._image_px = np.array([camera.width_px, camera.height_px], dtype=np.float64)
        self._px_per_rad = 0.5 * self._image_px / np.tan(self._half_view_rad)
        self._move_time, self._faces_tall = move_time, faces_tall

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._detector = FrameRate(1.0 / _FPS)
        self._goal_rad = view.joints.position_rad
        self._filter: CornerFilter | None = None
        self._frame_s = self._started_s = self._stopped_s = -math.inf
        self._moving = False
        self._seen_s = math.inf

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        if self._moving and view.idle:
            self._moving, self._stopped_s = False, self._frame_s
        for detection in self._detector.take(view.detections):
            velocity = self._estimate_velocity(view, detection)
            self._frame_s, self._seen_s = detection.arrival_time_s, view.time_s
            if not self._moving and self._frame_s > max(self._started_s, self._stopped_s):
                self._decide(view, detection, velocity)
        if not self._moving and view.time_s - self._seen_s >= _RETURN_S:
            self._seen_s = math.inf
            self._filter = None
            self._go(np.zeros(2))
        return self._goal_rad

    def _estimate_velocity(self, view: View, detection: Detection) -> FloatArray | None:
        """Plausible image velocity of the face, compensated for the camera's motion, shape (2,), pixels per frame."""
        head_rad = view.joints_at(detection.capture_time_s)
        if head_rad is None:
            return None
        # The source estimates the camera's motion from the background of the image.
        own_px = np.array([-head_rad[0], -head_rad[1]]) * self._px_per_rad
        centre_px = 0.5 * detection.offset * self._image_px + own_px
        corners_px = centre_px + 0.5 * detection.box_px * np.array([[-1.0], [1.0]])
        if self._filter is None:
            self._filter = CornerFilter(corners_px)
            return None
        return believed_velocity(self._filter.update(corners_px), self._image_px, _FPS)

    def _decide(self, view: View, detection: Detection, velocity: FloatArray | None) -> None:
        known = self._move_time is not None and velocity is not None
        if not self._is_far_off(detection, _DEAD_ZONE if known else _DEAD_ZONE_UNSURE):
            return
        move = detection.offset
        if self._move_time is not None and velocity is not None:
            frames = _FPS * self._move_time.predict_s(np.clip(move, -1.0, 1.0))
            move = move + frames * velocity / (0.5 * self._image_px)
        # To the left and up, in halves of the field of view; as in the source, image coordinates are taken as angles.
        self._go(view.joints.position_rad - np.clip(move, -1.0, 1.0) * self._half_view_rad)

    def _is_far_off(self, detection: Detection, share: float) -> bool:
        # The box of the person is clipped at the border of the image.
        box_px = np.minimum(detection.box_px * np.array([1.0, self._faces_tall]), self._image_px)
        side = int(np.argmax(box_px))
        size_px = self._image_px[side]
        away_px = float(np.linalg.norm(0.5 * detection.offset * self._image_px))
        return away_px >= float(share * size_px * (1.0 - math.log(box_px[side] / size_px)))

    def _go(self, goal_rad: FloatArray) -> None:
        self._goal_rad = self._within_range(goal_rad)
        self._moving, self._started_s, self._stopped_s = True, self._frame_s, math.inf


# Constants of Frigate for persons, `track/norfair_tracker.py` and `ptz/autotrack.py`; pixels and frames.
_R, _Q = 4.5, 0.25
_LARGEST_DIFFERENCE_PX = 20.0
_LARGEST_DEVIATION_PX = 10.0
_LIKE_DIFFERENCE_PX = 10.0
_LEAST_COSINE, _LEAST_COSINE_ALIKE = 0.93, 0.6
# Initial variance of the velocity (norfair's default).
_START_P = 10.0


class CornerFilter:
    """Independent constant-velocity Kalman filters of the coordinates of two corners.

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
        """Update with the corners of the next frame; velocity of both corners, shape (2, 2), pixels per frame."""
        self._kalman.predict()
        self._kalman.update(corners_px.ravel())
        velocity: FloatArray = self._kalman.x[4:, 0].reshape(2, 2).copy()
        return velocity


def believed_velocity(corners_px: FloatArray, image_px: FloatArray, fps: float) -> FloatArray | None:
    """Velocity of the box, if the corners' velocities are consistent.

    Args:
        corners_px: Velocity of both corners, shape (2, 2), pixels per frame.
        image_px: Width and height of the image, shape (2,), pixels.
        fps: Frames per second.

    Returns:
        Mean velocity, shape (2,), pixels per frame; None if the corners are too fast or inconsistent.
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


_MOVES = 30
# Bounds of intercept and slope, seconds.
_OFFSET_S = (0.1, 10.0)
_LARGEST_SLOPE_S = 2.0


class FrigateCalibration(Rival):
    """Measures the durations of pans of increasing size, there and back; arguments as of `Rival`."""

    name = "frigate_calibration"

    def __init__(self, neck: NeckSpec, camera: HeadCamera) -> None:
        super().__init__(neck, camera)
        most = float(neck.position_max_rad[0]) / camera.half_width_rad
        self._sizes = np.minimum(np.linspace(0.0, 1.0, _MOVES), most)

    def start(self, view: View) -> None:
        """See `Rival.start`."""
        self._times_s: list[float] = []
        self._started_s: float | None = None
        self._goal_rad = np.zeros(2)

    @property
    def finished(self) -> bool:
        """Whether all moves are complete."""
        return len(self._times_s) == _MOVES

    def step(self, view: View) -> FloatArray:
        """See `Rival.step`."""
        if self.finished or not view.idle:
            return self._goal_rad
        if self._started_s is not None:
            self._times_s.append(view.time_s - self._started_s)
            self._started_s = None
            self._goal_rad = np.zeros(2)
        else:
            self._started_s = view.time_s
            self._goal_rad = np.array([self._sizes[len(self._times_s)] * self._camera.half_width_rad, 0.0])
        return self._goal_rad

    def move_time(self) -> MoveTime | None:
        """Least-squares line of the durations; None outside the bounds of the source."""
        made = len(self._times_s)
        slope_s, offset_s = np.polyfit(self._sizes[:made], self._times_s, 1)
        if not (_OFFSET_S[0] <= offset_s <= _OFFSET_S[1] and 0.0 < slope_s <= _LARGEST_SLOPE_S):
            return None
        return MoveTime(float(offset_s), float(slope_s), self._times_s[0])
