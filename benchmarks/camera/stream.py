"""Error of the capture time, from images sent at known times."""

from __future__ import annotations

import itertools
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

from gazempc.live.sources.camera.blazeface import import_opencv
from gazempc.live.sources.camera.capture import Camera, CameraOptions, Picture
from gazempc.types import FloatArray

_FRAME_S = 1 / 30
# Images are identified by their grey level, which JPEG preserves to one or two of the steps of 12.
_GREYS = 20
_GREY_STEP = 12


class PictureServer:
    """Simulated network camera: motion JPEG over HTTP, 30 images per second.

    Attributes:
        url: Address of the stream.
        sent: Number of each image, and time at which its first byte was sent, on the clock of `time.monotonic`.
    """

    def __init__(self) -> None:
        self.sent: list[tuple[int, float]] = []
        self._hung_up = 0
        server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        server.daemon_threads = True
        self._server = server
        self.url = f"http://127.0.0.1:{server.server_port}/video.mjpg"
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()

    def number(self, rgb: Any) -> int:
        """Number of the last sent image with the grey level of this one."""
        grey = round(float(np.mean(rgb)) / _GREY_STEP)
        return next(number for number, _ in reversed(self.sent) if number % _GREYS == grey)

    def hang_up(self) -> None:
        """Close the current connections."""
        self._hung_up += 1

    def close(self) -> None:
        """Close all connections and the server."""
        self.hang_up()
        self._server.shutdown()
        self._server.server_close()

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        cv2, camera = import_opencv(), self
        jpegs = []
        for k in range(_GREYS):
            fine, jpeg = cv2.imencode(".jpg", np.full((480, 640, 3), k * _GREY_STEP, np.uint8))
            assert fine
            jpegs.append(jpeg.tobytes())

        class Handler(BaseHTTPRequestHandler):
            def log_message(self, *_: Any) -> None:
                """Suppress the log."""

            def do_GET(self) -> None:
                """Send images until the connection closes."""
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                start_s, hung_up = time.monotonic(), camera._hung_up
                for number in itertools.count():
                    jpeg = jpegs[number % _GREYS]
                    time.sleep(max(start_s + number * _FRAME_S - time.monotonic(), 0.0))
                    if camera._hung_up != hung_up:
                        return
                    camera.sent.append((number, time.monotonic()))
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                    try:
                        self.wfile.write(head.encode() + jpeg + b"\r\n")
                    except OSError:
                        return

        return Handler


def capture_errors_ms(pictures: int = 90) -> FloatArray:
    """Errors of a camera's time stamps.

    Args:
        pictures: Number of images.

    Returns:
        Time stamp minus time of sending, milliseconds, shape (pictures,).
    """
    server = PictureServer()
    camera = Camera(server.url, CameraOptions())
    errors_ms: list[float] = []
    try:
        while len(errors_ms) < pictures:
            picture = camera.read()
            if isinstance(picture, Picture):
                sent_s = dict(server.sent)[server.number(picture.rgb)]
                errors_ms.append(1e3 * (picture.captured_s - sent_s))
    finally:
        camera.close()
        server.close()
    return np.array(errors_ms)
