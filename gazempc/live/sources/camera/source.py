"""People in front of a camera: a process captures pictures and detects faces, the source reads its messages."""

from __future__ import annotations

import math
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any, NamedTuple

import numpy as np

from gazempc.errors import GazempcError, SettingsError
from gazempc.live.clock import Clock
from gazempc.live.process import start_child
from gazempc.live.sources.camera.blazeface import BlazeFace, import_opencv
from gazempc.live.sources.camera.capture import LIKELY_FOV_DEG, CameraOptions, Pictures, open_pictures
from gazempc.live.sources.camera.finder import FaceFinder
from gazempc.live.sources.camera.intrinsics import Intrinsics, from_calibration, from_field_of_view
from gazempc.live.sources.source import Arrived, Notice, SourceError
from gazempc.loop.events import Event
from gazempc.parts import error_line
from gazempc.people.tracker_faults import LOW_RATE_HZ, is_low_rate
from gazempc.results.moments import Moment, PictureMoment
from gazempc.robots.ptz_emulator import EMULATOR, picture_url
from gazempc.types import Sighting
from predictors import HeadObservation

_WINDOW_S, _LEAST_PICTURES, _LEAST_FACES = 4.0, 4, 3
# Share of the picture interval above which the search limits the rate; decoding may take the rest.
_BUSY = 0.6


class FaceRate:
    """Checks the rate of detected faces over the last four seconds, once in a run."""

    def __init__(self) -> None:
        self._pictures: deque[tuple[float, bool, float]] = deque()
        self._due_s: float | None = None

    def judge(self, captured_s: float, found: bool, search_s: float) -> str:
        """Add a picture.

        Args:
            captured_s: Capture time, seconds; increasing.
            found: Whether it contains a detected face.
            search_s: Time of the search, seconds.

        Returns:
            Cause of a rate below six faces a second; empty at a higher rate, and after the first report.
        """
        self._due_s = captured_s + _WINDOW_S if self._due_s is None else self._due_s
        self._pictures.append((captured_s, found, search_s))
        while self._pictures[0][0] < captured_s - _WINDOW_S:
            self._pictures.popleft()
        times_s, faces, searches_s = (np.array(column) for column in zip(*self._pictures, strict=True))
        enough = captured_s >= self._due_s and times_s.size >= _LEAST_PICTURES and faces.sum() >= _LEAST_FACES
        if not enough or not is_low_rate(times_s[faces]):
            return ""
        self._due_s = math.inf
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


class Opened(NamedTuple):
    """Message after the first picture.

    Attributes:
        about: Description of the camera.
        half_view_rad: Half of the pictures' width and height, radians.
    """

    about: str
    half_view_rad: tuple[float, float]


class Failed(NamedTuple):
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
    with closing(pictures):
        finder, rate, cv2 = FaceFinder(BlazeFace()), FaceRate(), import_opencv()
        intrinsics, latest_s, shown_s = None, -math.inf, -math.inf
        while (picture := pictures.read()) is not None:
            if isinstance(picture, str | Notice):
                parent.send(picture)
                continue
            if getattr(picture.rgb, "ndim", 0) != 3 or picture.rgb.shape[2] != 3 or picture.rgb.dtype.name != "uint8":
                raise SourceError(f"source camera:{address}: a picture is not RGB, shape (height, width, 3), uint8")
            if intrinsics is None:
                height, width = picture.rgb.shape[:2]
                intrinsics, about = _lens(options, width, height)
                parent.send(Opened(about, intrinsics.half_view_rad(width, height)))
            captured_s = picture.captured_s - 1e-3 * options.latency_ms
            if captured_s <= latest_s:
                continue  # a repeated picture
            latest_s = captured_s
            started_s = time.perf_counter()
            observations = finder.heads(picture.rgb, captured_s, intrinsics)
            for observation in observations:
                parent.send(observation)
            if why := rate.judge(captured_s, bool(observations), time.perf_counter() - started_s):
                parent.send(Notice(Event.LOW_FRAME_RATE, why, 0))
            if shows and captured_s - shown_s >= _PERIOD_S:
                shown_s = captured_s
                parent.send(PictureMoment(captured_s, _small(cv2, picture.rgb)))


def _lens(options: CameraOptions, width: int, height: int) -> tuple[Intrinsics, str]:
    """Camera intrinsics, and their description."""
    about = f"{width} x {height} pixels, "
    if options.calibration is not None:
        return from_calibration(options.calibration, width, height), f"{about}calibrated by {options.calibration}"
    about += f"{options.fov_deg or LIKELY_FOV_DEG:g} degrees across"
    if options.fov_deg is None:
        about += " ASSUMED: its error scales directions and distances; set --camera.fov-deg or --camera.calibration"
    return from_field_of_view(options.fov_deg or LIKELY_FOV_DEG, width, height), about


# Timeout of the first picture: cameras start in some seconds, the process more slowly on a busy or small computer.
_OPENS_WITHIN_S = 60.0
_ENDS_WITHIN_S = 3.0


class CameraSource:
    """Detects and tracks faces in the pictures of a camera, in a separate process.

    Positions are those of the point between the eyes, in the camera's frame: x along the view, y left, z up. They state
    their covariance: accurate direction, and distance from the size of the face. Without a person in view nothing is
    sent.

    Args:
        address: A number or nothing for the first camera, a device, a video file, a stream's URL, or module:Class for a
            camera of your own.
        options: Options of the camera.
        clock: The loop's clock.
        own: Values for the constructor of a user-defined camera.

    Attributes:
        half_view_rad: Half of the pictures' width and height, radians; None before the first picture.
        watch: Called with each of the small pictures for viewers in the thread of the run, and must return at once;
            None at `open` for no pictures.

    Raises:
        SettingsError: If field of view and calibration are both given.
    """

    def __init__(
        self, address: str, options: CameraOptions, clock: Clock, own: Mapping[str, Any] | None = None
    ) -> None:
        if options.calibration is not None and options.fov_deg is not None:
            raise SettingsError("--camera.fov-deg and --camera.calibration: give one of them")
        self._address, self._options, self._clock, self._own = address, options, clock, own
        self.half_view_rad: tuple[float, float] | None = None
        self._process: SpawnProcess | None = None
        self._messages: Connection | None = None
        self._ended = False
        self.watch: Callable[[Moment], None] | None = None

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`; waits for the first picture."""
        address = picture_url() if self._address == EMULATOR else self._address
        given = address, self._options, self.watch is not None, self._own
        self._process, self._messages = start_child("camera", serve, *given)
        self._ended = False
        try:
            self._wait_for_picture()
        except BaseException:
            self.close()
            raise

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        now_s, to_loop_s = self._clock.now_s(), self._clock.from_monotonic_s
        messages = list(iter(self._next, None))
        for message in messages:
            if isinstance(message, PictureMoment) and self.watch is not None:
                self.watch(message._replace(time_s=to_loop_s(message.time_s)))
        seen = [each for each in messages if isinstance(each, HeadObservation)]
        problems = [one.why if isinstance(one, Failed) else one for one in messages if isinstance(one, str | Failed)]
        return Arrived(
            tuple(Sighting(now_s, replace(each, capture_time_s=to_loop_s(each.capture_time_s))) for each in seen),
            tuple(filter(None, problems)),
            tuple(each for each in messages if isinstance(each, Notice)),
        )

    @property
    def finished(self) -> bool:
        """See `gazempc.live.sources.source.Source.finished`: True at the end of a file, or of the process."""
        return self._ended

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        process, messages = self._process, self._messages
        self._process = self._messages = None
        self._ended = True
        if messages is not None:
            messages.close()
        if process is not None:
            process.terminate()
            process.join(_ENDS_WITHIN_S)
            if process.is_alive():
                process.kill()
                process.join(_ENDS_WITHIN_S)

    def _wait_for_picture(self) -> None:
        until_s, name = time.monotonic() + _OPENS_WITHIN_S, f"source camera:{self._address}".rstrip(":")
        while (message := self._next(max(until_s - time.monotonic(), 0.0))) is not None:
            if isinstance(message, Opened):
                self.half_view_rad = message.half_view_rad
                print(f"{name}: {message.about}", file=sys.stderr, flush=True)
                return
            if isinstance(message, Failed):
                raise SourceError(message.why or f"{name}: it has no picture")
        raise SourceError(f"{name}: no picture within {_OPENS_WITHIN_S:.0f} s; is another program using it?")

    def _next(self, wait_s: float = 0.0) -> Message | None:
        """The next message; None after a timeout."""
        if self._messages is None or self._ended:
            return None
        try:
            message: Message | None = self._messages.recv() if self._messages.poll(wait_s) else None
        except (EOFError, OSError):
            message = Failed("the process of the camera has ended")
        self._ended = isinstance(message, Failed)
        return message
