"""People in front of a camera."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

from gazempc.errors import SettingsError
from gazempc.live.clock import Clock
from gazempc.live.process import start_child
from gazempc.live.sources.camera.capture import CameraOptions
from gazempc.live.sources.camera.worker import Failed, Message, Opened, serve
from gazempc.live.sources.source import Arrived, Notice, SourceError
from gazempc.results.moments import Moment, PictureMoment
from gazempc.robots.ptz_emulator import EMULATOR, picture_url
from gazempc.types import Sighting
from predictors import HeadObservation

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

    Raises:
        SettingsError: If field of view and calibration are both given.
    """

    def __init__(
        self,
        address: str,
        options: CameraOptions,
        clock: Clock,
        own: Mapping[str, Any] | None = None,
    ) -> None:
        if options.calibration is not None and options.fov_deg is not None:
            raise SettingsError("--camera.fov-deg and --camera.calibration: give one of them")
        self._address, self._options, self._clock, self._own = address, options, clock, own
        self.half_view_rad: tuple[float, float] | None = None
        self._process: SpawnProcess | None = None
        self._messages: Connection | None = None
        self._ended = False
        self._watch: Callable[[Moment], None] | None = None

    def show_to(self, watch: Callable[[Moment], None]) -> None:
        """Also send small pictures to a listener; call before `open`.

        Args:
            watch: Called with each in the thread of the run; must return at once.
        """
        self._watch = watch

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`; waits for the first picture."""
        if self._process is not None:
            return
        address = picture_url() if self._address == EMULATOR else self._address
        given = address, self._options, self._watch is not None, self._own
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
            if isinstance(message, PictureMoment) and self._watch is not None:
                self._watch(message._replace(time_s=to_loop_s(message.time_s)))
        seen = [each for each in messages if isinstance(each, HeadObservation)]
        problems = [
            each.why if isinstance(each, Failed) else each for each in messages if isinstance(each, str | Failed)
        ]
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
