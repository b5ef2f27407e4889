"""False faces per minute: `python -m benchmarks.camera.false_faces [VIDEO ...]`.

Images without visible faces: rendered heads from behind and from the side, pans over scikit-image's photographs without
people, and given videos of people from behind; each detection is false. It takes about two minutes.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from scipy.spatial.transform import Rotation

from benchmarks.camera.walks import FRAME_S, across, webcam
from gazempc.live.sources.camera.blazeface import BlazeFace, import_opencv
from gazempc.live.sources.camera.finder import FaceFinder
from gazempc.robots.studio import Studio, StudioPerson

_PHOTOGRAPHS = (
    *("brick", "cat", "clock", "coffee", "coins", "grass", "gravel", "hubble_deep_field", "immunohistochemistry"),
    *("moon", "page", "retina", "rocket"),
)
_RANGES_M, _TURNS_DEG = (0.7, 1.5, 2.5), (110.0, 130.0, 150.0, 180.0, 220.0)
_SECONDS = 3.0
_WIDTH, _HEIGHT = 640, 480


def backs(studio: Studio, range_m: float, turn_deg: float, dim: bool) -> Iterator[Any]:
    """Images of a person who walks across the field of view, turned away from the camera by an angle."""
    person_at = across(range_m, _SECONDS, 0.0)
    for k in range(round(_SECONDS / FRAME_S)):
        person = person_at(k * FRAME_S)
        turned = StudioPerson(person.eyes_m, person.yaw_rad + math.radians(turn_deg))
        picture = studio.picture(turned, np.zeros(3), Rotation.identity())
        yield webcam(picture) if dim else picture


def pan(photograph: Any) -> Iterator[Any]:
    """Images of a camera that pans over a photograph, enlarged to twice the field of view."""
    cv2 = import_opencv()
    rgb = np.ascontiguousarray(np.dstack([photograph] * 3) if photograph.ndim == 2 else photograph[:, :, :3])
    scale = max(2 * _WIDTH / rgb.shape[1], 1.5 * _HEIGHT / rgb.shape[0])
    large = cv2.resize(rgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    for share in np.linspace(0.0, 1.0, round(_SECONDS / FRAME_S)):
        left, top = round(share * (large.shape[1] - _WIDTH)), round(share * (large.shape[0] - _HEIGHT))
        yield np.ascontiguousarray(large[top : top + _HEIGHT, left : left + _WIDTH])


def frames(video: Path) -> tuple[Iterator[Any], float]:
    """Images of a video, and the frame interval."""
    cv2 = import_opencv()
    opened = cv2.VideoCapture(str(video))

    def pictures() -> Iterator[Any]:
        while (read := opened.read())[0]:
            yield cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB)

    return pictures(), 1.0 / (opened.get(cv2.CAP_PROP_FPS) or 1.0 / FRAME_S)


def count(detector: BlazeFace, kind: str, cameras: Iterable[Iterator[Any]], period_s: float = FRAME_S) -> None:
    """Detect faces in the images of each camera, and print the false-positive rate.

    Args:
        detector: Face detector.
        kind: Kind of the images.
        cameras: Images of each camera.
        period_s: Frame interval, seconds.
    """
    pictures = with_face = names = 0
    for camera in cameras:
        finder, seen = FaceFinder(detector), set()
        for k, picture in enumerate(camera):
            found = finder.detect(picture, k * period_s)
            pictures += 1
            with_face += bool(found)
            seen |= {person.person_id for person in found}
        names += len(seen)
    per_minute = 60 * names / (pictures * period_s)
    rates = f"{pictures:6} pictures, {with_face:4} with a false face, {per_minute:6.1f} false faces per minute"
    print(f"{kind:<52} {rates}", flush=True)


def main(videos: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()) -> None:
    """Count and print.

    Args:
        videos: Videos without visible faces.
    """
    detector, studio = BlazeFace(), Studio()
    data: Any = importlib.import_module("skimage.data")
    for dim in (False, True):
        for turn_deg in _TURNS_DEG:
            kind = f"rendered, turned away by {turn_deg:.0f} deg{', cheap webcam' if dim else ''}"
            count(detector, kind, (backs(studio, range_m, turn_deg, dim) for range_m in _RANGES_M))
    count(detector, "photographs without people", (pan(getattr(data, name)()) for name in _PHOTOGRAPHS))
    for video in videos:
        pictures, period_s = frames(video)
        count(detector, video.name, [pictures], period_s)
    studio.close()


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.camera.false_faces", description=__doc__)
