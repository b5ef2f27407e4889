"""Dynamixel motors on a serial line: packets of protocol 2.0, with validated replies."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from gazempc.errors import RobotError, importing
from gazempc.robots.options import DynamixelOptions

_HARDWARE_ERROR = (68, 3)  # Status Return Level, Registered Instruction, Hardware Error Status
_ALERT = 0x80
# By bit of the Hardware Error Status.
_HARDWARE_ERRORS = (
    "input voltage", "motor hall sensor", "overheating", "motor encoder", "electrical shock or insufficient power",
    "overload",
)  # fmt: skip


class DynamixelBus:
    """Transport on the serial line, independent of the meaning of the control table.

    Args:
        options: Port, baud rate, ids and timeout.
        joint_names: Names of the joints, in the order of the ids.

    Attributes:
        port_name: Serial port.
        wait_ms: Timeout of a reply; may be changed at any time.
    """

    def __init__(self, options: DynamixelOptions, joint_names: tuple[str, ...]) -> None:
        self.port_name, self.wait_ms = options.port, options.reply_timeout_ms
        self._names, self._ids, self._baud_rate_bps = joint_names, options.motor_ids, options.baud_rate_bps
        self._sdk: Any = None
        self._packets: Any = None
        self._port: Any = None

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._port is not None

    def open(self) -> None:
        """Open the port with exclusive access.

        Raises:
            MissingOptionalDependencyError: If dynamixel-sdk is not installed.
            RobotError: If it cannot be opened; names what to check.
        """
        with importing("a Dynamixel neck", "dynamixel-sdk", "dynamixel"):
            import dynamixel_sdk  # noqa: PLC0415  (optional)
        self._sdk, self._packets = dynamixel_sdk, dynamixel_sdk.PacketHandler(2.0)
        port = self._port = self._sdk.PortHandler(self.port_name)
        hint = "check that it exists, that no other program has it, and that you may use it (group dialout)"
        try:
            if not port.setBaudRate(self._baud_rate_bps):
                raise RobotError(f"{self.line}: not a baud rate of Dynamixel motors, such as 57600 or 1000000")
            # Exclusive access: replies of two programs would be mixed.
            port.ser.exclusive = True
        except OSError as error:
            raise RobotError(f"{self.line}: cannot be opened ({error}): {hint}") from error
        # The library busy-waits, with a timeout of 34 ms: seven ticks.
        port.ser.timeout = 0.5e-3
        # Reached only if the adapter accepts no bytes.
        port.ser.write_timeout = 0.05
        # An instruction of up to 30 bytes is sent before the reply.
        port.setPacketTimeout = lambda length: port.setPacketTimeoutMillis(
            self.wait_ms + (length + 30) * port.tx_time_per_byte
        )

        def read_in_time(length: int) -> bytes:
            # The library checks the timeout only without input: continuous noise would block it.
            if port.isPacketTimeout():
                raise RobotError(f"{self.line}: no complete reply in time; check power, cable and baud rate")
            return bytes(port.ser.read(length))

        port.readPort = read_in_time

    def drop(self) -> None:
        """Close the port; never raises."""
        with suppress(Exception):
            self._port.closePort()
        self._port = None

    @property
    def line(self) -> str:
        """Port and baud rate, for messages."""
        return f"{self.port_name} at {self._baud_rate_bps} baud"

    def motor(self, i: int) -> str:
        """Port and motor, for messages."""
        return f"{self.line}, motor {self._ids[i]} ({self._names[i]})"

    def ping(self, i: int) -> None:
        """Find one motor; raises RobotError without a reply or for an unsupported model."""
        self._port.is_using = False
        model, result, error = self._packets.ping(self._port, self._ids[i])
        self._require(i, result)
        self._refuse_error(i, error)
        # X motors, and MX motors with protocol 2.0, have this control table; XL-320, P and PRO have others.
        if model not in (*range(1000, 2000), 30, 311, 321):
            raise RobotError(f"{self.motor(i)}: model {model} is no X motor (nor MX with protocol 2.0); check the id")

    def write(self, part: tuple[int, int], values: dict[int, bytes]) -> None:
        """Write one part of several motors, by id, without acknowledgement; RobotError if it is not sent."""
        self._port.is_using = False
        group = self._sdk.GroupSyncWrite(self._port, self._packets, *part)
        for motor_id, value in values.items():
            group.addParam(motor_id, list(value))
        result = group.txPacket()
        if result != self._sdk.COMM_SUCCESS:
            raise RobotError(f"{self.line}: could not send ({self._packets.getTxRxResult(result)})")

    def read(self, part: tuple[int, int]) -> list[bytes]:
        """Read the same part of all motors; raises if a reply is missing or invalid, or a motor has an error."""
        answers = self._sync_read(part, *range(len(self._ids)))
        for i, (_, error) in enumerate(answers):
            self._refuse_error(i, error)
        return [data for data, _ in answers]

    def _sync_read(self, part: tuple[int, int], *axes: int) -> list[tuple[bytes, int]]:
        self._port.is_using = False
        group = self._sdk.GroupSyncRead(self._port, self._packets, *part)
        for i in axes:
            group.addParam(self._ids[i])
        result = group.txPacket()
        for i in axes:
            self._require(i, result)
        return [self._receive(i, part[1]) for i in axes]

    def _receive(self, i: int, length: int) -> tuple[bytes, int]:
        # Not the group's rxPacket and getData: they discard the error byte, accept a reply of any length, and return 0
        # for missing data, which would be half a turn.
        while True:
            packet, result = self._packets.rxPacket(self._port, False)
            self._require(i, result)
            error = packet[8]
            is_whole = packet[5] + 256 * packet[6] == length + 4
            # Other packets are late replies to requests that timed out.
            if packet[4] == self._ids[i] and (is_whole or error & ~_ALERT):
                return bytes(packet[9 : 9 + length]), error

    def _require(self, i: int, result: int) -> None:
        if result != self._sdk.COMM_SUCCESS:
            hint = "check power, cable, id, baud rate, Status Return Level (68) and the adapter's latency timer"
            raise RobotError(f"{self.motor(i)}: no valid reply ({self._packets.getTxRxResult(result)}): {hint}")

    def _refuse_error(self, i: int, error: int) -> None:
        if error & _ALERT:
            status = self._sync_read(_HARDWARE_ERROR, i)[0][0][2]
            names = [name for bit, name in enumerate(_HARDWARE_ERRORS) if status >> bit & 1]
            what = ", ".join(names) or f"status {status:#04x}"
            raise RobotError(f"{self.motor(i)}: hardware error: {what}; remove the cause, then switch it off and on")
        if error:
            raise RobotError(f"{self.motor(i)}: refused the instruction: {self._packets.getRxPacketError(error)}")
