"""Pan-tilt cameras by VISCA over IP: packets, a link with sequence numbers and retries, and the robot.

Packets and delivery follow Sony's description of VISCA over IP in the technical manuals of its cameras (SRG, BRC).
"""

from __future__ import annotations

import contextlib
import math
import socket
import subprocess
import sys
import time
from collections.abc import Callable

from gazempc.errors import RobotError, SettingsError
from gazempc.neck.spec import NeckSpec
from gazempc.robots import visca_packets as wire
from gazempc.robots.options import ViscaOptions
from gazempc.robots.ptz_emulator import EMULATOR, PtzEmulator
from gazempc.robots.speed_camera import Pair, SpeedCamera

PORT = 52381
# Bounds of the adaptive reply timeout.
_WAIT_MIN_S, _WAIT_MAX_S = 0.06, 0.5
_ATTEMPTS = 3
_ERRORS = {
    0x01: "wrong message length",
    0x02: "syntax error: the camera lacks this command",
    0x03: "command buffer full",
    0x04: "command cancelled",
    0x05: "no socket",
    0x41: "not executable now: is it in standby, or is its menu open?",
}
# Inquiries of `--probe`.
_QUESTIONS: tuple[tuple[str, bytes, Callable[[bytes], str]], ...] = (
    ("model", wire.VERSION, lambda a: f"vendor {a[:2].hex()}, model {a[2:4].hex()}, firmware {a[4:6].hex()}"),
    ("power", wire.POWER, lambda a: {b"\x02": "on", b"\x03": "standby"}.get(a, a.hex())),
    ("position", wire.POSITION, lambda a: "{} and {} counts".format(*(wire.position_of(a) or ("?", "?")))),
    ("fastest speeds", wire.MAX_SPEED, lambda a: " and ".join(str(speed) for speed in a)),
    ("zoom", wire.ZOOM, lambda a: a.hex()[1::2]),
)
# A guard process that stops the camera when the pipe to the run breaks, also after a kill.
_GUARD = """
import socket, sys, time
host, port, *packets = sys.argv[1:]
if not sys.stdin.buffer.read():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for packet in packets * 3:
            out.sendto(bytes.fromhex(packet), (host, int(port)))
            time.sleep(0.05)
"""


class ViscaLink:
    """Exchanges packets with a camera by UDP; not thread-safe.

    Retransmission uses the same sequence number, as the standard demands. Replies with another number are late, or out
    of order, and are ignored. After a sequence error the numbering is reset.

    Args:
        host: Address of the camera.
        port: Its UDP port.

    Attributes:
        host: Address of the camera.
        port: Its UDP port.
        name: Host and port, for messages.
    """

    def __init__(self, host: str, port: int) -> None:
        self.host, self.port = host, port
        self.name = f"visca {host}:{port}"
        self._socket: socket.socket | None = None
        self._sequence = 0
        self._answered_s = _WAIT_MAX_S / 2.0

    def open(self) -> None:
        """Open the socket, and reset the sequence number.

        Raises:
            RobotError: If there is no such host.
        """
        if self._socket is None:
            try:
                self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                self._socket.connect((self.host, self.port))
            except OSError as error:
                self.close()
                raise RobotError(f"{self.name}: {error}") from None
        self.reset()

    def reset(self) -> None:
        """Reset the sequence number. Some cameras do not reply to this, and ignore sequence numbers."""
        with contextlib.suppress(RobotError):
            self._exchange(wire.CONTROL, wire.RESET, attempts=1)

    def command(self, payload: bytes) -> None:
        """Send a command, and wait until it is accepted.

        Args:
            payload: The command.

        Raises:
            RobotError: If it is refused, or there is no reply in three attempts.
        """
        self._exchange(wire.COMMAND, payload)

    def inquire(self, payload: bytes) -> bytes:
        """Send an inquiry.

        Args:
            payload: The inquiry.

        Returns:
            The reply without header and terminator.

        Raises:
            RobotError: As `command`.
        """
        return self._exchange(wire.INQUIRY, payload)[2:-1]

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def _exchange(self, kind: int, payload: bytes, attempts: int = _ATTEMPTS) -> bytes:
        if self._socket is None:
            raise RobotError(f"{self.name}: not connected")
        self._sequence = (self._sequence + 1) % 2**32 if kind != wire.CONTROL else 0
        packet = wire.pack(kind, self._sequence, payload)
        reply = wire.CONTROL_REPLY if kind == wire.CONTROL else wire.REPLY
        why = "no reply"
        for attempt in range(attempts):
            started_s = time.monotonic()
            # Twice the usual reply time, increased after each loss.
            until_s = started_s + min(max(2.0 * self._answered_s, _WAIT_MIN_S) * (attempt + 1), _WAIT_MAX_S)
            try:
                self._socket.send(packet)
                answer = self._answer(until_s, reply)
            except OSError as error:
                answer, why = None, str(error)
            if answer is not None:
                self._answered_s += 0.25 * (time.monotonic() - started_s - self._answered_s)
                if answer == wire.SEQUENCE_ERROR and attempt == 0 and kind != wire.CONTROL:
                    # Sequence error, such as after a power cycle; of a later attempt only the reply was lost.
                    self.reset()
                    return self._exchange(kind, payload, 1)
                if len(answer) <= 2 or answer[1] & 0xF0 != 0x60:
                    return answer
                why = f"replied {_ERRORS.get(answer[2], f'error {answer[2]:#04x}')}"
                if answer[2] != 0x03:
                    raise RobotError(f"{self.name} {why}")
            time.sleep(max(until_s - time.monotonic(), 0.0))
        raise RobotError(f"{self.name}: {why} in {attempts} attempts; check its address, and that VISCA over IP is on")

    def _answer(self, until_s: float, reply: int) -> bytes | None:
        assert self._socket is not None
        while (left_s := until_s - time.monotonic()) > 0.0:
            self._socket.settimeout(left_s)
            try:
                kind, sequence, payload = wire.unpack(self._socket.recv(64)) or (None, None, b"")
            except TimeoutError:
                return None
            if reply == wire.CONTROL_REPLY == kind:
                return payload
            if sequence == self._sequence and (kind == reply or payload == wire.SEQUENCE_ERROR):
                return payload
        return None


class ViscaDevice:
    """A camera by VISCA, see `gazempc.robots.speed_camera.SpeedDevice`.

    Args:
        address: HOST or HOST:PORT; ``emulator`` or ``emulator:NECK`` starts an emulated camera.
        neck: The neck.
        options: Scale and directions.

    Raises:
        SettingsError: If the address is wrong.
    """

    def __init__(self, address: str, neck: NeckSpec, options: ViscaOptions) -> None:
        host, _, port = address.partition(":")
        self._emulator = PtzEmulator(port or neck) if host == EMULATOR else None
        if not host or (self._emulator is None and port and not (port.isdecimal() and int(port) < 65536)):
            raise SettingsError(f"robot visca:{address}: accepted: visca:HOST, visca:HOST:PORT, visca:emulator")
        self._link = ViscaLink(host, PORT if self._emulator or not port else int(port))
        self.steps = wire.visca_steps(neck)
        self._options, self._rad = options, math.radians(1.0 / options.counts_per_deg)
        self._guard: subprocess.Popen[bytes] | None = None

    def open(self) -> None:
        """See `SpeedDevice.open`; includes a test inquiry."""
        if self._emulator is not None:
            self._link = ViscaLink(*self._emulator.start())
        self._link.open()
        with contextlib.suppress(RobotError):
            self._link.inquire(wire.VERSION)
            return
        self._link.inquire(wire.POSITION)

    def drive(self, speeds_rad_s: Pair) -> None:
        """See `SpeedDevice.drive`."""
        if self._guard is None:
            self._start_guard()
        one, other = (
            direction * steps.step(speed)  # the table is that of the neck's directions
            for steps, speed, direction in zip(self.steps, speeds_rad_s, self._options.directions, strict=True)
        )
        self._link.command(wire.drive_payload(one, other))

    def angles_rad(self) -> Pair | None:
        """See `SpeedDevice.angles_rad`."""
        found = wire.position_of(self._link.inquire(wire.POSITION))
        if found is None:
            return None
        # VISCA counts pan to the right.
        pan, tilt = self._options.directions
        return -pan * found[0] * self._rad, tilt * found[1] * self._rad

    def recover(self) -> None:
        """See `SpeedDevice.recover`: resets the sequence number, for a camera after a power cycle."""
        self._link.reset()

    def about(self) -> list[tuple[str, str]]:
        """See `SpeedDevice.about`."""
        found = [("address", f"{self._link.host}:{self._link.port} (VISCA over IP, UDP)")]
        for name, payload, shown in _QUESTIONS:
            try:
                found.append((name, shown(self._link.inquire(payload))))
            except RobotError as error:
                found.append((name, f"no reply ({str(error).partition(': ')[2] or error})"))
        speeds = " and ".join(str(len(steps.positive_rad_s)) for steps in self.steps)
        return [*found, ("speeds", f"{speeds} for pan and tilt; their deg/s are measured by gazempc identify")]

    def close(self) -> None:
        """See `SpeedDevice.close`."""
        self._link.close()
        if self._guard is not None and self._guard.stdin is not None:
            with contextlib.suppress(OSError):
                self._guard.stdin.write(b".")
                self._guard.stdin.close()
            self._guard.wait()
        self._guard = None
        if self._emulator is not None:
            self._emulator.close()

    def _start_guard(self) -> None:
        # VISCA moves have no timeout: after a kill of the run the camera would keep turning.
        packets = wire.pack(wire.CONTROL, 0, wire.RESET), wire.pack(wire.COMMAND, 1, wire.drive_payload(0, 0))
        address = self._link.host, str(self._link.port)
        words = [sys.executable, "-I", "-S", "-c", _GUARD, *address, *map(bytes.hex, packets)]
        self._guard = subprocess.Popen(words, stdin=subprocess.PIPE, start_new_session=True)


class ViscaCamera(SpeedCamera):
    """Robot ``visca:HOST[:PORT]``. Without position commands of VISCA, whose units depend on the manufacturer.

    Args:
        address: HOST, HOST:PORT or ``emulator``.
        neck: The neck; speeds without a table are 24 and 20 equal steps to the top speed.
        clock_s: The loop's time, seconds.
        options: Scale and directions.
    """

    def __init__(self, address: str, neck: NeckSpec, clock_s: Callable[[], float], options: ViscaOptions) -> None:
        device = ViscaDevice(address, neck, options)
        super().__init__(device, neck, clock_s, device.steps)
