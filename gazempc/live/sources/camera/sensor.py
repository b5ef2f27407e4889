"""From pictures to observations of one person."""

from __future__ import annotations

from typing import Any

from gazempc.live.sources.camera.finder import Detector, FaceFinder, Followed
from gazempc.live.sources.camera.head import POINT_SD, head_from_points
from gazempc.live.sources.camera.intrinsics import Intrinsics
from predictors import HeadObservation


class FaceSensor:
    """Observes the person whom it has looked at before, else the nearest one.

    Args:
        detector: Finds faces in a square of a picture.
        intrinsics: Which way each pixel looks.
    """

    def __init__(self, detector: Detector, intrinsics: Intrinsics) -> None:
        self._finder = FaceFinder(detector)
        self._intrinsics = intrinsics
        self._whom: str | None = None

    def see(self, picture: Any, time_s: float) -> HeadObservation | None:
        """Take one picture in.

        Args:
            picture: RGB, shape (height, width, 3), uint8.
            time_s: When it was captured, seconds; later than the last one.

        Returns:
            The person in the camera's frame (x along the view, y left, z up); None if nobody is seen, or only somebody
            else while the person may come back.
        """
        here = self._finder.see(picture, time_s)
        if self._whom not in self._finder.names:
            self._whom = max(here, key=lambda person: person.width_px).person_id if here else None
        for person in here:
            if person.person_id == self._whom:
                return self._observation(person, time_s)
        return None

    def _observation(self, person: Followed, time_s: float) -> HeadObservation:
        rays = self._intrinsics.rays(person.face.points_px)
        head = head_from_points(rays, POINT_SD * person.side_px / self._intrinsics.focal_px, person.face.score)
        return HeadObservation(
            capture_time_s=time_s,
            head_position_base_m=head.position_m,
            head_quat_wxyz=head.quat_wxyz,
            position_covariance_m2=head.covariance_m2,
            head_yaw_sd_rad=head.yaw_sd_rad,
            person_id=person.person_id,
            confidence=person.face.score,
        )
