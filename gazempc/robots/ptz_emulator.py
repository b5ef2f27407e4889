"""An emulated pan-tilt camera: simulated by MuJoCo, commanded by VISCA, with a realistic latency of the picture.

It runs in a separate process in real time. A person walks to and fro before it.
"""

from __future__ import annotations

import math
import multiprocessing
import signal
import threading
import time
from collections import deque
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import GazempcError, RobotError, importing
from gazempc.neck.spec import NeckSpec, load_neck

# Host name and source address of the emulator.
EMULATOR = "emulator"
# Field of view, and time from the exposure of a picture to its first byte.
FOV_DEG = 60.0
LATENCY_S = 0.2
_SIZE = (480, 270)
# Width and height of its picture.
VIEW_DEG = FOV_DEG, math.degrees(2.0 * math.atan(_SIZE[1] / _SIZE[0] * math.tan(math.radians(0.5 * FOV_DEG))))
_FPS = 10.0
# The person walks a sine across the view.
_DISTANCE_M, _ASIDE_M, _PERIOD_S, _UP_M = 1.8, 0.9, 12.0, 0.1


class PtzEmulator:
    """An emulated camera, in a separate process from `start` to `close`.

    Args:
        neck: The camera: a neck with velocity-controlled joints, by name, file or value.
    """

    running: PtzEmulator | None = None

    def __init__(self, neck: str | NeckSpec) -> None:
        self._neck = load_neck(neck) if isinstance(neck, str) else neck
        self._process: SpawnProcess | None = None
        self._pipe: Connection | None = None
        self.address = ("", 0)
        self.picture_url = ""

    def start(self) -> tuple[str, int]:
        """Start the process; idempotent.

        Returns:
            Host and port of VISCA.

        Raises:
            RobotError: If the start fails, for example without MuJoCo; states the reason.
        """
        if self._process is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(self._neck, theirs), name="emulator", daemon=True)
            self._process.start()
            theirs.close()
            try:
                found = self._pipe.recv() if self._pipe.poll(60.0) else "it did not start"
            except EOFError:
                found = "its process ended"
            if isinstance(found, str):
                self.close()
                raise RobotError(f"emulated camera: {found}")
            self.address, self.picture_url = found
            PtzEmulator.running = self
        return self.address

    def close(self) -> None:
        """End the process."""
        if PtzEmulator.running is self:
            PtzEmulator.running = None
        if self._process is not None and self._pipe is not None:
            self._pipe.close()
            self._process.terminate()
            self._process.join()
        self._process = None


def picture_url() -> str:
    """Address of the emulated camera's picture.

    Raises:
        RobotError: If no emulated camera runs.
    """
    if PtzEmulator.running is None:
        raise RobotError("source camera:emulator: no emulated camera runs; accepted with --robot visca:emulator")
    return PtzEmulator.running.picture_url


def _server(pictures: deque[tuple[float, bytes]]) -> ThreadingHTTPServer:
    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

        def do_GET(self) -> None:
            """Send pictures until the connection closes."""
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            # Only pictures newer than the connection are sent.
            due_s = time.monotonic()
            while True:
                later = next((each for each in tuple(pictures) if due_s < each[0]), None)
                if later is None or later[0] > time.monotonic():
                    time.sleep(1e-3)
                    continue
                due_s, jpeg = later
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                try:
                    self.wfile.write(head.encode() + jpeg + b"\r\n")
                except OSError:
                    return

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, name="pictures", daemon=True).start()
    return server


def _serve(neck: NeckSpec, pipe: Connection) -> None:
    # Ctrl-C is for the run, which stops the camera first.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        _emulate(neck, pipe)
    except (GazempcError, RuntimeError) as error:
        pipe.send(str(error))


def _emulate(neck: NeckSpec, pipe: Connection) -> None:
    from gazempc.robots.mujoco import MujocoNeck  # noqa: PLC0415
    from gazempc.robots.studio import Studio, StudioPerson  # noqa: PLC0415
    from gazempc.robots.visca_server import ViscaServer  # noqa: PLC0415

    with importing("the emulated camera", "opencv-python-headless", "ptz"):
        import cv2  # noqa: PLC0415
    view_deg = FOV_DEG if neck.head_view_deg is None else neck.head_view_deg[0]
    studio = Studio(*_SIZE, view_deg)
    plant, lock = MujocoNeck(neck, time.monotonic), threading.Lock()
    pictures: deque[tuple[float, bytes]] = deque(maxlen=64)  # each with the time at which it is due
    plant.connect()
    visca, web = ViscaServer(plant, neck, lock), _server(pictures)
    pipe.send((visca.address, f"http://127.0.0.1:{web.server_port}/camera.mjpg"))
    start_s = exposed_s = time.monotonic()
    # Until the run closes its end of the pipe.
    while not pipe.poll(max(exposed_s - time.monotonic(), 0.0)):
        with lock:
            plant.true_state()
            exposed_s = time.monotonic()
            head = plant.data.body("head")
            place_m, turn = np.array(head.xpos), Rotation.from_matrix(np.array(head.xmat).reshape(3, 3))
        aside_m = _ASIDE_M * math.sin(math.tau * (exposed_s - start_s) / _PERIOD_S)
        person = StudioPerson(np.array([_DISTANCE_M, aside_m, _UP_M]), math.pi + math.atan2(aside_m, _DISTANCE_M))
        rgb = studio.picture(person, place_m + turn.apply(neck.geometry.eye_in_tilt_m), turn)
        _, jpeg = cv2.imencode(".jpg", rgb[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
        pictures.append((exposed_s + LATENCY_S, jpeg.tobytes()))
        exposed_s += 1.0 / _FPS
