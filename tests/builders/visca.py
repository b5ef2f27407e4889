"""A camera with VISCA on this computer, and a network that loses, delays and reorders its packets."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

import numpy as np
import pytest

from builders.robots import with_both
from builders.waiting import wait_for
from gazempc.neck.spec import NeckSpec, load_neck
from gazempc.robots.options import ViscaOptions
from gazempc.robots.ptz_emulator import ViscaServer, picture_url
from gazempc.robots.visca import ViscaCamera
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import FloatArray, JointState

PTZ = load_neck("ptz")
QUICK = with_both(PTZ, dead_time_s=0.0)


class BadNetwork:
    """Between robot and camera: `spoil` gets each packet and its number, and returns the packets to pass on.

    Args:
        camera: Host and port of the camera.
        to_camera: Spoils what the robot sends.
        to_robot: Spoils what the camera answers.
    """

    def __init__(
        self,
        camera: tuple[str, int],
        to_camera: Callable[[int, bytes], list[bytes]] = lambda _, packet: [packet],
        to_robot: Callable[[int, bytes], list[bytes]] = lambda _, packet: [packet],
    ) -> None:
        self._spoil = {True: to_camera, False: to_robot}
        self.seen: dict[bool, list[bytes]] = {True: [], False: []}
        self._camera, self._robot = camera, ("", 0)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.05)
        self.address = self._socket.getsockname()
        self._closing = False
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._closing = True
        self._thread.join()
        self._socket.close()

    def _work(self) -> None:
        while not self._closing:
            try:
                packet, sender = self._socket.recvfrom(64)
            except OSError:
                continue
            to_camera = sender != self._camera
            if to_camera:
                self._robot = sender
            self.seen[to_camera].append(packet)
            for each in self._spoil[to_camera](len(self.seen[to_camera]) - 1, packet):
                self._socket.sendto(each, self._camera if to_camera else self._robot)


class SharedNeck(SimulatedNeck):
    """A thread-safe simulated neck in real time."""

    def __init__(self, neck: NeckSpec) -> None:
        self._lock = threading.RLock()
        super().__init__(neck, np.zeros(2), time.monotonic)
        self.connect()

    def true_state(self) -> JointState:
        with self._lock:
            return super().true_state()

    def send_command(self, command: FloatArray) -> FloatArray:
        with self._lock:
            return super().send_command(command)


@contextmanager
def camera(neck: NeckSpec = QUICK) -> Iterator[tuple[ViscaServer, SharedNeck]]:
    """A camera and its simulated neck."""
    plant = SharedNeck(neck)
    server = ViscaServer(plant, neck)
    try:
        yield server, plant
    finally:
        server.close()


@contextmanager
def connected(address: tuple[str, int], neck: NeckSpec = QUICK, **options: object) -> Iterator[ViscaCamera]:
    """A robot at an address, connected."""
    place = f"{address[0]}:{address[1]}"
    robot = ViscaCamera(place, neck, time.monotonic, ViscaOptions.model_validate(options))
    robot.connect()
    try:
        yield robot
    finally:
        robot.close()


def feed(robot: ViscaCamera, speeds: tuple[float, float], until: Callable[[], bool]) -> None:
    """Send speeds at 50 Hz, as the loop does, until a condition holds."""

    def send() -> None:
        robot.send_command(np.array(speeds))
        time.sleep(0.02)

    wait_for(until, step=send)


@contextmanager
def emulated(protocol):
    """Robot and picture of the emulated camera by a protocol, as words of the command line."""
    for package in ("mujoco", "cv2", "skimage"):
        pytest.importorskip(package)
    if protocol == "visca":
        yield "--robot visca:emulator --source camera:emulator"
        return
    onvif = pytest.importorskip("builders.onvif")
    with closing(onvif.EmulatedCamera(PTZ)) as plant, onvif.onvif_camera(PTZ, plant=plant) as server:
        picture = f"--source camera:{picture_url()} --camera.fov-deg 60 --camera.latency-ms 200"
        view = "--framing.view-deg 60 36 --options.onvif.range-deg 100 -100 -25 25"
        yield f"--robot onvif:127.0.0.1:{server.port} --neck ptz {picture} {view}"
