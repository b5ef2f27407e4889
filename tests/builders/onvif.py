"""An ONVIF camera on this computer: the corrected service of ipycam turns a simulated neck."""

import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np
from ipycam.config import CameraConfig
from ipycam.onvif import ONVIFService

from builders.visca import SharedNeck
from gazempc.errors import RobotError
from gazempc.neck.spec import NeckSpec
from gazempc.robots.options import ViscaOptions
from gazempc.robots.ptz_emulator import EMULATOR
from gazempc.robots.visca import ViscaCamera
from gazempc.types import FloatArray, JointState

# ipycam 1.3 declares no prefix in this answer, and leaves the places of the move status unfilled.
_STATUS = """<tptz:GetStatusResponse xmlns:tptz="http://www.onvif.org/ver20/ptz/wsdl">
  <tptz:PTZStatus xmlns:tt="http://www.onvif.org/ver10/schema">
    <tt:Position><tt:PanTilt x="{{pan}}" y="{{tilt}}"/><tt:Zoom x="{{zoom}}"/></tt:Position>
    <tt:MoveStatus><tt:PanTilt>{{move_status}}</tt:PanTilt><tt:Zoom>IDLE</tt:Zoom></tt:MoveStatus>
    <tt:UtcTime>2026-01-01T00:00:00Z</tt:UtcTime>
  </tptz:PTZStatus>
</tptz:GetStatusResponse>"""


class OnvifCameraServer:
    """The camera: pan to the right is positive by ONVIF's convention, and a move ends after its Timeout.

    Attributes:
        moves: Time by `time.monotonic`, and x and y of each ContinuousMove; Stop is (0, 0).
        bodies: Every request.
        says_moving: Whether its move status is always MOVING.
        silent: Whether connections are closed without an answer.
    """

    def __init__(self, neck: NeckSpec, user: str = "", password: str = "", plant: Any = None) -> None:
        self.neck, self.moves, self.bodies = neck, [], []
        self.says_moving = self.silent = False
        self.plant = plant or SharedNeck(neck)
        self._lock, self._ends_s = threading.RLock(), np.inf
        self._half = 0.5 * (neck.position_max_rad - neck.position_min_rad)
        handler = self._handler()
        self._web = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self._web.daemon_threads = True
        self.port = self._web.server_port
        config = CameraConfig(local_ip="127.0.0.1", onvif_port=self.port)
        config.username, config.password = user, password
        self.service = ONVIFService(config, self)
        self.service._templates["ptz_get_status"] = _STATUS
        threading.Thread(target=self._web.serve_forever, args=(0.02,), daemon=True).start()
        threading.Thread(target=self._time_out, daemon=True).start()

    def close(self) -> None:
        self._web.shutdown()
        self._web.server_close()

    def continuous_move(self, x: float, y: float, _: float = 0.0) -> None:
        with self._lock:
            self.moves.append((time.monotonic(), x, y))
            self.plant.send_command(np.array([-x, y]) * self.neck.velocity_max_rad_s)

    def stop_movement(self, *_: bool) -> None:
        self.continuous_move(0.0, 0.0)

    def get_status(self) -> dict[str, Any]:
        with self._lock:
            at = self.plant.true_state().position_rad / self._half
        return {"pan": -at[0], "tilt": at[1], "zoom": 0.0, "moving": self.says_moving}

    def _time_out(self) -> None:
        while True:
            time.sleep(0.02)
            with self._lock:
                if time.monotonic() > self._ends_s:
                    self._ends_s = np.inf
                    self.plant.send_command(np.zeros(2))

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        camera = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            wbufsize = 65536  # header and body in one packet

            def log_message(self, *_: Any) -> None:
                pass

            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"])).decode()
                if camera.silent:
                    self.close_connection = True
                    return
                camera.bodies.append(body)
                action = re.search(r"Body[^>]*>\s*<(?:\w+:)?(\w+)", body).group(1)
                status = 200
                if action != "GetSystemDateAndTime" and not camera.service.verify_usernametoken(body):
                    status, answer = 401, camera.service.fault("Sender not authorized")
                else:
                    if action == "ContinuousMove":
                        timeout = re.search(r"Timeout>PT(\d+)S<", body)
                        # A camera measured runs for 180 s without one.
                        with camera._lock:
                            camera._ends_s = time.monotonic() + (float(timeout.group(1)) if timeout else 180.0)
                    answer = camera.service.handle_action(action, body)
                packed = answer.encode()
                self.send_response(status)
                self.send_header("Content-Type", "application/soap+xml; charset=utf-8")
                self.send_header("Content-Length", str(len(packed)))
                self.end_headers()
                self.wfile.write(packed)

        return Handler


class EmulatedCamera:
    """The plant that is the emulated camera with its rendered picture; VISCA turns it."""

    def __init__(self, neck: NeckSpec) -> None:
        self._robot = ViscaCamera(EMULATOR, neck, time.monotonic, ViscaOptions())
        self._robot.connect()
        self._speeds_rad_s, self._state = np.zeros(2), None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def send_command(self, speeds_rad_s: FloatArray) -> None:
        self._speeds_rad_s = speeds_rad_s

    def true_state(self) -> JointState:
        while self._state is None:
            time.sleep(0.01)
        return self._state

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
        self._robot.close()

    def _work(self) -> None:
        while not self._closing.wait(0.02):
            with suppress(RobotError):  # a busy machine answers late
                self._robot.send_command(self._speeds_rad_s)
                self._state = self._robot.read_state() or self._state


@contextmanager
def onvif_camera(neck: NeckSpec, user: str = "", password: str = "", plant: Any = None) -> Iterator[OnvifCameraServer]:
    server = OnvifCameraServer(neck, user, password, plant)
    try:
        yield server
    finally:
        server.close()
