"""Small pictures of a camera, for people who watch."""

from __future__ import annotations

from dataclasses import dataclass

from gazempc.live.sources.camera.blazeface import import_opencv
from gazempc.live.sources.camera.capture import Picture

# So many pixels and pictures are enough to see who is there, and cost the run next to nothing.
_WIDTH_PX = 320
_QUALITY = 60
_PERIOD_S = 0.2


@dataclass(frozen=True)
class Shown:
    """A small picture.

    Attributes:
        captured_s: When it was captured, on the clock of `time.monotonic`, seconds.
        jpeg: The picture.
    """

    captured_s: float
    jpeg: bytes


class Showing:
    """Makes small pictures, five a second."""

    def __init__(self) -> None:
        self._cv2 = import_opencv()
        self._last_s = float("-inf")

    def of(self, picture: Picture, captured_s: float) -> Shown | None:
        """The small one of a picture.

        Args:
            picture: The picture.
            captured_s: When it was captured, seconds.

        Returns:
            The small one; None if it is too soon after the last one.
        """
        if captured_s - self._last_s < _PERIOD_S:
            return None
        self._last_s = captured_s
        height, width = picture.rgb.shape[:2]
        size = (_WIDTH_PX, max(1, round(height * _WIDTH_PX / width)))
        small = self._cv2.resize(picture.rgb, size, interpolation=self._cv2.INTER_AREA)
        _, jpeg = self._cv2.imencode(".jpg", small[:, :, ::-1], [self._cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        return Shown(captured_s, jpeg.tobytes())
