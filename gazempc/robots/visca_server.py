"""VISCA over IP server of the emulated camera, after the manufacturers' documentation."""

from __future__ import annotations

import math
import socket
import threading
import time

import numpy as np

from gazempc.neck.spec import NeckSpec
from gazempc.robots import visca_packets as wire
from gazempc.robots.robot import Robot

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
    """Listens on a local UDP port, and commands a neck.

    Args:
        plant: The neck, connected: velocity-controlled, with `true_state`.
        neck: The neck with its speed table.
        plant_lock: Held while the plant is used.

    Attributes:
        address: Host and port.
        driven: The commands Pan-tiltDrive so far: time by `time.monotonic`, steps of pan and tilt.
        silent: Whether packets are ignored, as by a camera without power.
    """

    def __init__(self, plant: Robot, neck: NeckSpec, plant_lock: threading.Lock | None = None) -> None:
        self._plant, self._lock = plant, plant_lock or threading.Lock()
        self._steps = wire.visca_steps(neck)
        self._sequence = 0
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
                self._sequence = 0
            return [wire.pack(wire.CONTROL_REPLY, sequence, wire.RESET)]
        if kind == wire.INQUIRY:
            self._sequence = max(sequence, self._sequence)
            return [wire.pack(wire.REPLY, sequence, self._answer(payload))]
        if kind != wire.COMMAND or sequence <= self._sequence:
            # Retransmitted or out of order: not executed twice. Another type is an error of the message.
            error = wire.SEQUENCE_ERROR if kind == wire.COMMAND else b"\x0f\x02"
            return [wire.pack(wire.CONTROL_REPLY, sequence, error)]
        self._sequence = sequence
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
