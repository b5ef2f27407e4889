"""Detection and tracking of faces in pictures."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from gazempc.live.sources.camera.blazeface import BlazeFace, Face
from gazempc.live.sources.camera.head import POINT_SD, head_from_points
from gazempc.live.sources.camera.intrinsics import Intrinsics
from gazempc.types import FloatArray
from predictors import HeadObservation

# Side of the search window in widths of the face: the scale of the network's training data, with room for a motion of
# about half a width.
_ROOM = 2.5
# Squares of this share of the picture's height, half a square apart, are searched in turn: a face 4 m away (24 of 640
# pixels, with 60 degrees in view) is still found in them. A face nearer than 1 m is larger than their overlap. It is
# found in the whole picture.
_SQUARE = 2.0 / 3.0
_SEARCHED = 2  # squares per picture
# Minimum scores: of a new face, of its second detection in its own cut-out, and of a tracked face. With these,
# none was found in 44 pictures without people, and a dim webcam's person at 3 m in each of 18.
_NEW_SCORE, _SURE_SCORE, _KNOWN_SCORE = 0.4, 0.5, 0.35
# Hair, necks and bald heads from behind score as high as faces, in up to three pictures of a video in a row, but their
# mirror images do not: at this score 22 % of them pass, and 76 % of faces of 20 to 50 pixels (labelled pedestrians).
_MIRRORED_SCORE = 0.4
# Confirmation of a new face: consecutive pictures, and duration. Key points alone discriminate badly.
_CONFIRMED_BY, _CONFIRMED_S = 3, 0.2
# Below this score a tracked face is also checked by its mirror image: the person may turn away.
_UNSURE_SCORE, _UNSURE_MIRRORED_SCORE = 0.5, 0.3
# Minimum width of a face (8 m, with 640 pixels of 60 degrees): smaller ones are confused with magnified noise.
_LEAST_PX = 12
# Lifetime of a track without detections; on a slow computer at least until the next picture.
_TRACK_LIFETIME_S = 1.0
# Bounds of re-identification: displacement in widths of the face, and change of its width.
_SAME_WIDTHS, _SAME_CHANGE = 3.0, 1.5


@dataclass(frozen=True, eq=False)
class FaceTrack:
    """Track of a face.

    Attributes:
        person_id: The name; empty until the face is confirmed.
        face: The last detection.
        seen_s: Time of the last detection, seconds.
        velocity_px_s: Velocity in the picture, shape (2,).
        side_px: Side of the search window of the last detection.
        since_s: Time of the first detection, seconds.
        pictures: Number of detections.
    """

    person_id: str
    face: Face
    seen_s: float
    velocity_px_s: FloatArray
    side_px: int
    since_s: float
    pictures: int

    def middle_at(self, time_s: float) -> FloatArray:
        """Predicted centre of the face, shape (2,), pixels."""
        return self.face.box_px[:2] + (time_s - self.seen_s) * self.velocity_px_s


class FaceFinder:
    """Detects and tracks faces.

    Args:
        detector: Detects faces in a square.
    """

    def __init__(self, detector: BlazeFace) -> None:
        self._detector = detector
        self._known: list[FaceTrack] = []
        self._names = itertools.count(1)
        self._turn = 0
        self._latest_s = -math.inf

    def detect(self, picture: Any, time_s: float) -> list[FaceTrack]:
        """Process one picture.

        Args:
            picture: RGB, shape (height, width, 3), uint8.
            time_s: Capture time, seconds; strictly increasing.

        Returns:
            The tracks with a face in it.
        """
        since_s = min(time_s - _TRACK_LIFETIME_S, self._latest_s)
        self._latest_s = time_s
        known = [person for person in self._known if person.seen_s >= since_s]
        here: list[FaceTrack] = []
        lost: list[FaceTrack] = []
        for person in known:
            found = self._follow(picture, person, time_s)
            # Duplicate tracks of one face: the older one is kept.
            if found is not None and not any(_overlap(found[0], other.face) for other in here):
                here.append(self._found(person, *found, time_s))
            elif person.person_id:
                lost.append(person)
        for corner_px, side_px in self._next_squares(picture.shape[1], picture.shape[0]):
            for face in self._detector.faces(picture, corner_px, side_px, _NEW_SCORE):
                if any(_overlap(face, other.face) for other in here):
                    continue
                sure = self._again(picture, face, _SURE_SCORE)
                if sure is None or any(_overlap(sure[0], other.face) for other in here):
                    continue
                if self._again(picture, sure[0], _MIRRORED_SCORE, mirrored=True):
                    before = _same(sure[0], lost, time_s)
                    lost = [person for person in lost if person is not before]
                    here.append(self._found(before, *sure, time_s))
        self._known = here + lost
        return [person for person in here if person.person_id]

    def heads(self, picture: Any, time_s: float, intrinsics: Intrinsics) -> list[HeadObservation]:
        """Process one picture as `detect` does.

        Args:
            picture: RGB, shape (height, width, 3), uint8.
            time_s: Capture time, seconds; strictly increasing.
            intrinsics: Camera intrinsics.

        Returns:
            One observation per named person, in the camera's frame: x along the view, y left, z up.
        """
        found = []
        for person in self.detect(picture, time_s):
            rays = intrinsics.rays(person.face.points_px)
            # The first element is the focal length in pixels.
            point_sd = POINT_SD * person.side_px / float(intrinsics.matrix[0, 0])
            found.append(head_from_points(rays, point_sd, person.face.score, time_s, person.person_id))
        return found

    def _follow(self, picture: Any, person: FaceTrack, time_s: float) -> tuple[Face, int] | None:
        middle_px = person.middle_at(time_s)
        found = self._near(picture, middle_px, person.face.width_px, _KNOWN_SCORE)
        if found is not None:
            if person.person_id and found[0].score >= _UNSURE_SCORE:
                return found
            score_min = _UNSURE_MIRRORED_SCORE if person.person_id else _MIRRORED_SCORE
            return found if self._again(picture, found[0], score_min, mirrored=True) else None
        if not person.person_id or person.seen_s < time_s - 0.5 * _TRACK_LIFETIME_S:
            return None
        # The camera may have turned with the head: repeat in a larger window.
        side_px = _square_px(picture.shape[0])
        for face in self._detector.faces(picture, _corner(middle_px, side_px), side_px, _NEW_SCORE):
            if _same(face, [person], time_s):
                return self._again(picture, face, _KNOWN_SCORE)
        return None

    def _near(
        self, picture: Any, middle_px: FloatArray, width_px: float, score_min: float, mirrored: bool = False
    ) -> tuple[Face, int] | None:
        """The face near a position, and the side of its search window."""
        side_px = max(round(_ROOM * width_px), 8)
        faces = self._detector.faces(picture, _corner(middle_px, side_px), side_px, score_min, mirrored)
        height, width = picture.shape[:2]
        near = [
            face
            for face in faces
            if math.dist(face.box_px[:2], middle_px) < width_px
            and 0.5 < face.width_px / width_px < 2.0
            and face.width_px >= _LEAST_PX
            and 0 <= face.box_px[0] < width
            and 0 <= face.box_px[1] < height
        ]
        return (near[0], side_px) if near else None

    def _again(self, picture: Any, face: Face, score_min: float, mirrored: bool = False) -> tuple[Face, int] | None:
        """A face in its own search window, see `_near`."""
        return self._near(picture, face.box_px[:2], face.width_px, score_min, mirrored)

    def _found(self, before: FaceTrack | None, face: Face, side_px: int, time_s: float) -> FaceTrack:
        if before is None:
            return FaceTrack("", face, time_s, np.zeros(2), side_px, time_s, 1)
        velocity_px_s = (face.box_px[:2] - before.face.box_px[:2]) / (time_s - before.seen_s)
        name, since_s, pictures = before.person_id, before.since_s, before.pictures + 1
        if not name and pictures >= _CONFIRMED_BY and time_s - since_s >= _CONFIRMED_S:
            name = str(next(self._names))
        return FaceTrack(name, face, time_s, velocity_px_s, side_px, since_s, pictures)

    def _next_squares(self, width: int, height: int) -> list[tuple[tuple[int, int], int]]:
        squares = search_squares(width, height)
        chosen = [squares[(self._turn + k) % len(squares)] for k in range(_SEARCHED)]
        self._turn = (self._turn + _SEARCHED) % len(squares)
        return chosen


def search_squares(width: int, height: int) -> list[tuple[tuple[int, int], int]]:
    """Squares that cover a picture, and one around all of it.

    Args:
        width: Width of the picture, pixels.
        height: Height, pixels.

    Returns:
        First pixel (column, row) and side of each, pixels.
    """
    side = _square_px(height)
    whole = max(width, height)
    columns, rows = (_starts(length, side) for length in (width, height))
    return [((-(whole - width) // 2, -(whole - height) // 2), whole), *(((x, y), side) for y in rows for x in columns)]


def _square_px(height: int) -> int:
    return round(_SQUARE * height)


def _starts(length: int, side: int) -> list[int]:
    """First pixels of squares at most half a side apart."""
    count = max(math.ceil(2 * (length - side) / side), 0) + 1
    return [round(k * (length - side) / max(count - 1, 1)) for k in range(count)]


def _corner(middle_px: FloatArray, side_px: int) -> tuple[int, int]:
    return round(float(middle_px[0]) - side_px / 2), round(float(middle_px[1]) - side_px / 2)


def _overlap(one: Face, other: Face) -> bool:
    """Whether the centre of one face is inside the other one."""
    return bool(np.all(np.abs(one.box_px[:2] - other.box_px[:2]) < 0.5 * np.maximum(one.box_px[2:], other.box_px[2:])))


def _same(face: Face, lost: list[FaceTrack], time_s: float) -> FaceTrack | None:
    """Re-identification: the nearest lost track."""
    width_px = face.width_px

    def away(person: FaceTrack) -> float:
        return min(math.dist(face.box_px[:2], p) for p in (person.middle_at(time_s), person.face.box_px[:2]))

    like = [p for p in lost if max(width_px / p.face.width_px, p.face.width_px / width_px) < _SAME_CHANGE]
    near = [p for p in like if away(p) < _SAME_WIDTHS * width_px]
    return min(near, key=away) if near else None
