"""The process of the camera source: capture, face detection, and transmission of observations and small pictures."""

from __future__ import annotations

import signal
import sys
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from gazempc.errors import GazempcError
from gazempc.live.sources.camera.blazeface import BlazeFace, import_opencv
from gazempc.live.sources.camera.capture import LIKELY_FOV_DEG, CameraOptions, Pictures, open_pictures
from gazempc.live.sources.camera.finder import FaceSensor
from gazempc.live.sources.camera.intrinsics import Intrinsics, from_calibration, from_field_of_view
from gazempc.live.sources.source import Notice, SourceError
from gazempc.loop.events import Event
from gazempc.parts import error_line
from gazempc.people.tracker_faults import LOW_RATE_HZ, is_low_rate
from gazempc.results.moments import PictureMoment
from predictors import HeadObservation

_WINDOW_S, _LEAST_PICTURES, _LEAST_FACES = 4.0, 4, 3
# Share of the picture interval above which the search limits the rate; decoding may take the rest.
_BUSY = 0.6


class FaceRate:
    """Checks the rate of detected faces over the last four seconds, once in a run."""

    def __init__(self) -> None:
        self._pictures: deque[tuple[float, bool, float]] = deque()
        self._warned = False
        self._first_s: float | None = None

    def judge(self, captured_s: float, found: bool, search_s: float) -> str:
        """Add a picture.

        Args:
            captured_s: Capture time, seconds; increasing.
            found: Whether it contains a detected face.
            search_s: Time of the search, seconds.

        Returns:
            Cause of a rate below six faces a second; empty at a higher rate, and after the first report.
        """
        self._first_s = captured_s if self._first_s is None else self._first_s
        self._pictures.append((captured_s, found, search_s))
        while self._pictures[0][0] < captured_s - _WINDOW_S:
            self._pictures.popleft()
        times_s, faces, searches_s = (np.array(column) for column in zip(*self._pictures, strict=True))
        enough = captured_s - self._first_s >= _WINDOW_S and times_s.size >= _LEAST_PICTURES
        if self._warned or not enough or faces.sum() < _LEAST_FACES or not is_low_rate(times_s[faces]):
            return ""
        self._warned = True
        rate_hz, search_s = 1.0 / float(np.median(np.diff(times_s))), float(np.median(searches_s))
        below = f"below {LOW_RATE_HZ:.0f} faces a second the gaze trails a walking person"
        if not is_low_rate(times_s):
            return (
                f"a face in {100 * faces.mean():.0f} % of {rate_hz:.0f} pictures a second; {below}: more light, a "
                "nearer person, or a camera that sees faces from the front"
            )
        if search_s * rate_hz > _BUSY:
            return (
                f"the search takes {1e3 * search_s:.0f} ms a picture, so {rate_hz:.1f} pictures a second are "
                f"searched; {below}: a faster or less busy computer"
            )
        return (
            f"camera or video give {rate_hz:.1f} pictures a second; {below}: a video with more pictures a second; of "
            "a camera a larger --camera.fps, or more light, as many slow down in the dark"
        )


# Size and rate of small pictures for viewers, at negligible cost for the run.
_WIDTH_PX = 320
_QUALITY = 60
_PERIOD_S = 0.2


def _small(cv2: Any, rgb: Any) -> bytes:
    height, width = rgb.shape[:2]
    size = (_WIDTH_PX, max(1, round(height * _WIDTH_PX / width)))
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", small[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return bytes(jpeg)


@dataclass(frozen=True)
class Opened:
    """Message after the first picture.

    Attributes:
        about: Description of the camera.
        half_view_rad: Half of the pictures' width and height, radians.
    """

    about: str
    half_view_rad: tuple[float, float]


@dataclass(frozen=True)
class Failed:
    """Last message.

    Attributes:
        why: The error; empty at the end of a file.
    """

    why: str = ""


# Capture times are on the clock of `time.monotonic`; a text is a transient problem.
Message = Opened | Failed | HeadObservation | Notice | PictureMoment | str


def serve(parent: Connection, address: str, options: CameraOptions, shows: bool, own: Mapping[str, Any] | None) -> None:
    """Work until the end of the pictures or of the parent process.

    Args:
        address: See `gazempc.live.sources.camera.capture.open_pictures`.
        options: Options of the camera.
        parent: Pipe for messages.
        shows: Whether small pictures are also sent.
        own: Values for the constructor of a user-defined camera.
    """
    # The camera is always released.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with suppress(ConnectionError):  # the parent has ended
        why = ""
        try:
            _work(open_pictures(address, options, own), address, options, parent, shows)
        except (GazempcError, ValueError) as error:
            why = str(error)
        except ConnectionError:
            raise
        except Exception as error:
            why = f"the process of the camera ended: {error_line(error)}"
        parent.send(Failed(why))


def _work(pictures: Pictures, address: str, options: CameraOptions, parent: Connection, shows: bool) -> None:
    try:
        detector, rate, cv2 = BlazeFace(), FaceRate(), import_opencv()
        sensor, latest_s, shown_s = None, float("-inf"), float("-inf")
        while (picture := pictures.read()) is not None:
            if isinstance(picture, str | Notice):
                parent.send(picture)
                continue
            if getattr(picture.rgb, "ndim", 0) != 3 or picture.rgb.shape[2] != 3 or picture.rgb.dtype.name != "uint8":
                raise SourceError(f"source camera:{address}: a picture is not RGB, shape (height, width, 3), uint8")
            if sensor is None:
                height, width = picture.rgb.shape[:2]
                intrinsics, about = _lens(options, width, height)
                sensor = FaceSensor(detector, intrinsics)
                parent.send(Opened(about, intrinsics.half_view_rad(width, height)))
            captured_s = picture.captured_s - 1e-3 * options.latency_ms
            if captured_s <= latest_s:
                continue  # a repeated picture
            latest_s = captured_s
            started_s = time.perf_counter()
            observations = sensor.detect(picture.rgb, captured_s)
            for observation in observations:
                parent.send(observation)
            if why := rate.judge(captured_s, bool(observations), time.perf_counter() - started_s):
                parent.send(Notice(Event.LOW_FRAME_RATE, why, 0))
            if shows and captured_s - shown_s >= _PERIOD_S:
                shown_s = captured_s
                parent.send(PictureMoment(captured_s, _small(cv2, picture.rgb)))
    finally:
        pictures.close()


def _lens(options: CameraOptions, width: int, height: int) -> tuple[Intrinsics, str]:
    """Camera intrinsics, and their description."""
    about = f"{width} x {height} pixels, "
    if options.calibration is not None:
        return from_calibration(options.calibration, width, height), f"{about}calibrated by {options.calibration}"
    intrinsics = from_field_of_view(options.fov_deg or LIKELY_FOV_DEG, width, height)
    if options.fov_deg is not None:
        return intrinsics, f"{about}{options.fov_deg:g} degrees across"
    return intrinsics, (
        f"{about}{LIKELY_FOV_DEG:g} degrees across ASSUMED: its error scales directions and distances; "
        "set --camera.fov-deg, or give --camera.calibration"
    )
