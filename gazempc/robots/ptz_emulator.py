"""An emulated pan-tilt camera: simulated by MuJoCo, commanded by VISCA, with a realistic latency of the picture.

It runs in a separate process in real time. A person walks to and fro before it.
"""

from __future__ import annotations

import math
import multiprocessing
import signal
import socket
import threading
import time
from collections import deque
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gazempc.errors import GazempcError, RobotError, importing
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.robots import visca_packets as wire
from gazempc.robots.robot import Robot

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
        self.picture_url = ""

    def start(self) -> tuple[str, int]:
        """Start the process.

        Returns:
            Host and port of VISCA.

        Raises:
            RobotError: If the start fails, for example without MuJoCo; states the reason.
        """
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
        (host, port), self.picture_url = found
        PtzEmulator.running = self
        return str(host), int(port)

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
            with suppress(OSError):
                while True:
                    later = next((each for each in tuple(pictures) if due_s < each[0]), None)
                    if later is None or later[0] > time.monotonic():
                        time.sleep(1e-3)
                        continue
                    due_s, jpeg = later
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                    self.wfile.write(head.encode() + jpeg + b"\r\n")

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


# Position counts of pan and tilt, as of most cameras.
COUNTS_PER_DEG = 14.4
_ACK, _DONE = bytes.fromhex("9041ff"), bytes.fromhex("9051ff")
_SYNTAX_ERROR = bytes.fromhex("906002ff")
# Vendor and model 0: not of a manufacturer.
_ANSWERS = {
    wire.VERSION: bytes.fromhex("905000000000010002ff"),
    wire.POWER: bytes.fromhex("905002ff"),
    wire.MAX_SPEED: bytes([0x90, 0x50, *wire.SPEEDS, 0xFF]),
    wire.ZOOM: bytes.fromhex("905000000000ff"),
}


class ViscaServer:
    """VISCA over IP after the manufacturers' documentation: listens on a local UDP port, and commands a neck.

    Args:
        plant: The neck, connected: velocity-controlled, with `true_state`.
        neck: The neck with its speed table.
        plant_lock: Held while the plant is used.

    Attributes:
        address: Host and port.
        driven: The commands Pan-tiltDrive so far: time by `time.monotonic`, steps of pan and tilt.
        silent: Whether packets are ignored, as by a camera without power.
        sequence: Number of the last packet; 0 after a start.
    """

    def __init__(self, plant: Robot, neck: NeckSpec, plant_lock: threading.Lock | None = None) -> None:
        self._plant, self._lock = plant, plant_lock or threading.Lock()
        self._steps = wire.visca_steps(neck)
        self.sequence = 0
        self.driven: list[tuple[float, int, int]] = []
        self.silent = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.address: tuple[str, int] = self._socket.getsockname()
        self._closing = False
        self._thread = threading.Thread(target=self._work, name="visca", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening."""
        self._closing = True
        self._thread.join()
        self._socket.close()

    def _work(self) -> None:
        self._socket.settimeout(0.05)
        while not self._closing:
            try:
                packet, sender = self._socket.recvfrom(64)
            except OSError:
                continue
            for answer in () if self.silent else self._answers(packet):
                self._socket.sendto(answer, sender)

    def _answers(self, packet: bytes) -> list[bytes]:
        found = wire.unpack(packet)
        if found is None:
            return []
        kind, sequence, payload = found
        if kind == wire.CONTROL:
            if payload == wire.RESET:
                self.sequence = 0
            return [wire.pack(wire.CONTROL_REPLY, sequence, wire.RESET)]
        if kind == wire.INQUIRY:
            self.sequence = max(sequence, self.sequence)
            return [wire.pack(wire.REPLY, sequence, self._answer(payload))]
        if kind != wire.COMMAND or sequence <= self.sequence:
            # Retransmitted or out of order: not executed twice. Another type is an error of the message.
            error = wire.SEQUENCE_ERROR if kind == wire.COMMAND else b"\x0f\x02"
            return [wire.pack(wire.CONTROL_REPLY, sequence, error)]
        self.sequence = sequence
        steps = wire.drive_of(payload)
        if steps is None:
            return [wire.pack(wire.REPLY, sequence, _SYNTAX_ERROR)]
        self.driven.append((time.monotonic(), *steps))
        speeds = [table.speed_rad_s(step) for table, step in zip(self._steps, steps, strict=True)]
        with self._lock:
            self._plant.send_command(np.array(speeds))
        return [wire.pack(wire.REPLY, sequence, _ACK), wire.pack(wire.REPLY, sequence, _DONE)]

    def _answer(self, payload: bytes) -> bytes:
        if payload != wire.POSITION:
            return _ANSWERS.get(payload, _SYNTAX_ERROR)
        with self._lock:
            state = self._plant.read_state()
        if state is None:
            return _SYNTAX_ERROR
        pan, tilt = (math.degrees(angle) * COUNTS_PER_DEG for angle in state.position_rad)
        return wire.position_payload(round(-pan), round(tilt))
