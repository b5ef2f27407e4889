"""Pictures with their time of capture: from a camera, a stream, a video file, or a user-defined camera."""

from __future__ import annotations

import math
import os
import re
import threading
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from pydantic import Field

from gazempc.live.sources.camera.blazeface import import_opencv
from gazempc.live.sources.source import Notice, SourceError
from gazempc.loop.events import Event
from gazempc.part_options import make
from gazempc.parts import Kind, is_own
from gazempc.settings import Settings

# Typical webcams: 55 to 78 degrees.
LIKELY_FOV_DEG = 65.0


class CameraOptions(Settings):
    """Source `camera`; see `gazempc.live.sources.camera.source.CameraSource`."""

    fov_deg: float | None = Field(
        default=None,
        gt=5,
        lt=170,
        description=f"Horizontal field of view; default {LIKELY_FOV_DEG:.0f}, with a note",
    )
    calibration: Path | None = Field(
        default=None, description="OpenCV's or ROS's calibration file (.yml, .yaml, .xml, .json), in place of fov-deg"
    )
    width: int = Field(default=640, ge=64, le=4096, description="Requested width, pixels")
    height: int = Field(default=480, ge=64, le=4096, description="Requested height, pixels")
    fps: float = Field(default=30.0, gt=0, le=240, description="Requested pictures a second")
    latency_ms: float = Field(
        default=0.0, ge=0, le=2000, description="Time from the exposure of a picture to its time stamp"
    )


# Maximum age of a driver's stamp on the clock of `time.monotonic`.
_STAMP_AGE_MAX_S = 1.0
# Time before a camera without pictures is reopened.
_RETRY_S = 1.0
# Timeouts of a network camera: without a picture, and with an unchanged picture.
_SILENT_S, _SAME_S = 2.0, 1.0
# Lag behind the fastest picture of the last minute at which a stream is reopened.
_LAG_S, _LAG_OVER_S = 0.5, 60.0
# Maximum lateness of a picture of a file; later ones are skipped.
_LATE_S = 0.05


# User and plain password of an address, in place of the name of an environment variable.
_PLAIN_PASSWORD = re.compile(r"://[^/@\s:]*:[^/@\s$][^/@\s]*@")


def check_address(address: str) -> None:
    """Refuse the address of a stream with a password: it would be in the log, the report and the list of processes.

    Raises:
        SourceError: If it contains a password; the name of an environment variable is accepted.
    """
    if _PLAIN_PASSWORD.search(address):
        raise SourceError(
            "source camera: the address has a password, which would be in the log and the report; accepted: the name "
            "of an environment variable in single quotes, such as 'camera:rtsp://me:$CAMERA_PASSWORD@192.168.0.8/1'"
        )


class Picture(NamedTuple):
    """A picture.

    Attributes:
        rgb: Shape (height, width, 3), uint8.
        captured_s: Capture time on the clock of `time.monotonic`, seconds.
    """

    rgb: Any
    captured_s: float


CAMERA = Kind(
    "camera",
    {},
    {
        "read": "read() -> (RGB picture, its time of capture by time.monotonic()); blocks; None at the end",
        "close": "close(): releases the camera",
    },
)


class Pictures(Protocol):
    """A stream of pictures."""

    def read(self) -> Picture | Notice | str | None:
        """The newest unread picture; blocks until it arrives.

        Returns:
            The picture; a text or a notice for a transient problem; None at the end.
        """

    def close(self) -> None:
        """Release the camera."""


class VideoFile:
    """Real-time playback of a video, from its first picture; late pictures are skipped.

    Args:
        path: The file.

    Raises:
        SourceError: If OpenCV cannot read it.
    """

    def __init__(self, path: Path) -> None:
        self._cv2 = import_opencv()
        self._video = self._cv2.VideoCapture(str(path))
        if not self._video.isOpened():
            raise SourceError(f"source camera:{path}: OpenCV cannot read this file; expected a video")
        self._start_s: float | None = None

    def read(self) -> Picture | str | None:
        """See `Pictures.read`."""
        while self._video.grab():
            in_file_s = 1e-3 * float(self._video.get(self._cv2.CAP_PROP_POS_MSEC))
            if self._start_s is None:
                self._start_s = time.monotonic() - in_file_s
            captured_s = self._start_s + in_file_s
            if time.monotonic() > captured_s + _LATE_S:
                continue
            fine, bgr = self._video.retrieve()
            if fine:
                time.sleep(max(captured_s - time.monotonic(), 0.0))
                return Picture(self._cv2.cvtColor(bgr, self._cv2.COLOR_BGR2RGB), captured_s)
        return None

    def close(self) -> None:
        """See `Pictures.close`."""
        self._video.release()


class StreamWatch:
    """Detects a frozen stream, and growing latency by its own time stamps."""

    def __init__(self) -> None:
        self._picture, self._since_s, self.frozen = b"", -math.inf, False
        # Arrival time, and delay after the stamp; ascending in both.
        self._offsets: deque[tuple[float, float]] = deque()

    def is_same(self, bgr: Any, arrived_s: float) -> bool:
        """Whether the picture is unchanged for a second.

        Args:
            bgr: The picture.
            arrived_s: Its arrival, seconds.
        """
        picture = bgr[::8, ::8].tobytes()
        if picture != self._picture:
            self._picture, self._since_s = picture, arrived_s
        return arrived_s - self._since_s > _SAME_S

    def lag_s(self, stamp_s: float, arrived_s: float) -> float:
        """Delay of a picture relative to the minimum delay of the last minute, seconds.

        Args:
            stamp_s: The stream's stamp, seconds on any clock.
            arrived_s: Its arrival, seconds.
        """
        offset_s = arrived_s - stamp_s
        while self._offsets and self._offsets[-1][1] >= offset_s:
            self._offsets.pop()
        self._offsets.append((arrived_s, offset_s))
        while self._offsets[0][0] < arrived_s - _LAG_OVER_S:
            self._offsets.popleft()
        return offset_s - self._offsets[0][1]


class Camera:
    """A camera of this computer, or a stream from the network. A thread reads all pictures; `read` returns the newest.

    The capture time is the stamp of the Linux driver; elsewhere the arrival time, minus the lag of an RTSP stream by
    its own stamps.

    Args:
        address: A number (empty: the first camera), a device such as ``/dev/video2``, or a URL.
        options: Options of the camera.

    Raises:
        SourceError: If it cannot be opened.
    """

    def __init__(self, address: str, options: CameraOptions) -> None:
        self._cv2 = import_opencv()
        self._address: int | str = int(address or "0") if not address or address.isdigit() else address
        self._options, self._streams = options, "://" in address
        self._camera = self._open()
        if not self._camera.isOpened():
            raise SourceError(
                f"source camera:{address}: OpenCV cannot open it; accepted: a number (camera:0 is the first camera), "
                "a device such as /dev/video0, a video file, a URL, module:Class for a camera of your own"
            )
        self._fresh = threading.Condition()
        self._newest: tuple[Any, float] | Notice | str | None = None
        self._closing = False
        self._watch = StreamWatch()
        self._thread = threading.Thread(target=self._take, name="camera", daemon=True)
        self._thread.start()

    def read(self) -> Picture | Notice | str | None:
        """See `Pictures.read`."""
        with self._fresh:
            patience_s = _SILENT_S if self._streams and not self._watch.frozen else None
            if not self._fresh.wait_for(lambda: self._newest is not None or self._closing, patience_s):
                self._watch.frozen = True
                return Notice(Event.STREAM_FROZEN, f"camera {self._address}: no picture for {_SILENT_S:g} s", 0)
            newest, self._newest = self._newest, None
        if newest is None or isinstance(newest, str | Notice):
            return newest
        return Picture(self._cv2.cvtColor(newest[0], self._cv2.COLOR_BGR2RGB), newest[1])

    def close(self) -> None:
        """See `Pictures.close`."""
        with self._fresh:
            self._closing = True
            self._fresh.notify_all()
        self._thread.join(_RETRY_S)

    def _open(self) -> Any:
        cv2, options = self._cv2, self._options
        if self._streams:
            # A password in the environment appears in no list of processes, log or message.
            return cv2.VideoCapture(os.path.expandvars(str(self._address)), cv2.CAP_FFMPEG)
        camera = cv2.VideoCapture(self._address)
        # MJPEG passes any USB port at full rate; a camera ignores unsupported settings.
        camera.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        camera.set(cv2.CAP_PROP_FRAME_WIDTH, options.width)
        camera.set(cv2.CAP_PROP_FRAME_HEIGHT, options.height)
        camera.set(cv2.CAP_PROP_FPS, options.fps)
        return camera

    def _take(self) -> None:
        while not self._closing:
            if not self._camera.grab():
                self._give(f"camera {self._address}: no picture; it is reopened")
                self._open_again(_RETRY_S)
                continue
            captured_s = self._captured_s(time.monotonic())
            fine, bgr = self._camera.retrieve()
            if fine and self._streams:
                self._take_streamed(bgr, captured_s)
            elif fine:
                self._give((bgr, captured_s))
        self._camera.release()

    def _take_streamed(self, bgr: Any, arrived_s: float) -> None:
        watch, lag_s = self._watch, 0.0
        if str(self._address).startswith("rtsp"):
            # Stamps of other streams are artificial.
            lag_s = watch.lag_s(1e-3 * float(self._camera.get(self._cv2.CAP_PROP_POS_MSEC)), arrived_s)
        if watch.is_same(bgr, arrived_s):
            if not watch.frozen:
                watch.frozen = True
                self._give(Notice(Event.STREAM_FROZEN, f"camera {self._address}: one picture for {_SAME_S:g} s", 0))
            return
        watch.frozen = False
        if lag_s > _LAG_S:
            text = f"camera {self._address}: {lag_s:.1f} s behind; it is opened again"
            self._give(Notice(Event.STREAM_LAGS, text, 0))
            self._open_again(0.0)
        else:
            self._give((bgr, arrived_s - lag_s))

    def _open_again(self, after_s: float) -> None:
        self._camera.release()
        time.sleep(after_s)
        self._camera, self._watch = self._open(), StreamWatch()

    def _give(self, newest: tuple[Any, float] | Notice | str) -> None:
        with self._fresh:
            self._newest = newest
            self._fresh.notify_all()

    def _captured_s(self, now_s: float) -> float:
        if self._camera.getBackendName() != "V4L2":
            return now_s
        stamp_s = 1e-3 * float(self._camera.get(self._cv2.CAP_PROP_POS_MSEC))
        return stamp_s if 0.0 <= now_s - stamp_s <= _STAMP_AGE_MAX_S else now_s


class OwnCamera:
    """A user-defined camera.

    Args:
        choice: ``module:Class``.
        own: Values for parameters of its constructor, by name.

    Raises:
        SettingsError: If it cannot be constructed, or a method is missing.
    """

    def __init__(self, choice: str, own: Mapping[str, Any] | None = None) -> None:
        self._camera = make(CAMERA, choice, {}, own or {})
        self.close = self._camera.close

    def read(self) -> Picture | None:
        """See `Pictures.read`."""
        given = self._camera.read()
        return None if given is None else Picture(*given)


def open_pictures(address: str, options: CameraOptions, own: Mapping[str, Any] | None = None) -> Pictures:
    """Open a camera.

    Args:
        address: A number or nothing for the first camera, a device, a video file, a stream's URL, or module:Class.
        options: Options of the camera.
        own: Values for the constructor of a user-defined camera.

    Returns:
        Its pictures.

    Raises:
        SourceError: If it cannot be opened.
        SettingsError: If a user-defined camera cannot be constructed.
        MissingOptionalDependencyError: If OpenCV is not installed.
    """
    if is_own(address):
        return OwnCamera(address, own)
    if Path(address).is_file():
        return VideoFile(Path(address))
    return Camera(address, options)
