"""Packets of VISCA over IP, for the robot and for its emulator."""

from __future__ import annotations

import struct

from gazempc.errors import SettingsError
from gazempc.neck.spec import AXES, NeckSpec
from gazempc.neck.speed_steps import SpeedSteps

# Types of payload.
COMMAND, INQUIRY, REPLY, CONTROL, CONTROL_REPLY = 0x0100, 0x0110, 0x0111, 0x0200, 0x0201
RESET = b"\x01"
SEQUENCE_ERROR = b"\x0f\x01"
_HEADER = struct.Struct(">HHI")
_DRIVE = bytes.fromhex("81010601")
VERSION = bytes.fromhex("81090002ff")
POSITION = bytes.fromhex("81090612ff")
MAX_SPEED = bytes.fromhex("81090611ff")
POWER = bytes.fromhex("81090400ff")
ZOOM = bytes.fromhex("81090447ff")
# Speeds of pan and tilt.
SPEEDS = (24, 20)
_LEFT_UP, _RIGHT_DOWN, _STOP = 1, 2, 3


def pack(kind: int, sequence: int, payload: bytes) -> bytes:
    """A packet with its header."""
    return _HEADER.pack(kind, len(payload), sequence) + payload


def unpack(packet: bytes) -> tuple[int, int, bytes] | None:
    """Type, sequence number and payload of a packet; None for invalid data."""
    if len(packet) <= _HEADER.size:
        return None
    kind, length, sequence = _HEADER.unpack_from(packet)
    payload = packet[_HEADER.size :]
    return (kind, sequence, payload) if len(payload) == length else None


def drive_payload(pan: int, tilt: int) -> bytes:
    """The command Pan-tiltDrive.

    Args:
        pan: Speed step of pan, positive to the left; 0 stops.
        tilt: Speed step of tilt, positive up.

    Returns:
        The payload.
    """
    ways = [_STOP if step == 0 else _LEFT_UP if step > 0 else _RIGHT_DOWN for step in (pan, tilt)]
    return _DRIVE + bytes([max(abs(pan), 1), max(abs(tilt), 1), *ways, 0xFF])


def drive_of(payload: bytes) -> tuple[int, int] | None:
    """Speed steps of a command Pan-tiltDrive, as in `drive_payload`; None if it is another command or out of range."""
    if len(payload) != 9 or not payload.startswith(_DRIVE):
        return None
    found = []
    for step, way, most in zip(payload[4:6], payload[6:8], SPEEDS, strict=True):
        if not (1 <= step <= most and _LEFT_UP <= way <= _STOP):
            return None
        found.append(0 if way == _STOP else step if way == _LEFT_UP else -step)
    return found[0], found[1]


def position_payload(pan: int, tilt: int) -> bytes:
    """The reply to `POSITION`: counts to the right and up, 16 bits each."""
    nibbles = [(count & 0xFFFF) >> shift & 0xF for count in (pan, tilt) for shift in (12, 8, 4, 0)]
    return bytes([0x90, 0x50, *nibbles, 0xFF])


def position_of(answer: bytes) -> tuple[int, int] | None:
    """Counts of pan and tilt in a reply without header and terminator; some cameras use five digits for pan or both."""
    digits = {8: 4, 9: 5, 10: 5}.get(len(answer))
    if digits is None or max(answer) > 0xF:
        return None
    counts = []
    for part in (answer[:digits], answer[digits:]):
        value = int("".join(f"{nibble:x}" for nibble in part), 16)
        half = 1 << (4 * len(part) - 1)
        counts.append(value - 2 * half if value >= half else value)
    return counts[0], counts[1]


def visca_steps(neck: NeckSpec) -> tuple[SpeedSteps, SpeedSteps]:
    """Speeds of a VISCA camera: the table of the neck file, else 24 and 20 equidistant steps to the top speed.

    Raises:
        SettingsError: If a table has more steps than the protocol.
    """
    for name, axis, count in zip(AXES, (neck.pan, neck.tilt), SPEEDS, strict=True):
        given = axis.speed_steps
        if given is not None and max(map(len, (given.positive_rad_s, given.negative_rad_s))) > count:
            raise SettingsError(f"neck {neck.name!r}, {name}.speed_steps: accepted by VISCA: at most {count} speeds")
    pan, tilt = (
        axis.speed_steps or SpeedSteps.equal(axis.full_rad_s, count)
        for axis, count in zip((neck.pan, neck.tilt), SPEEDS, strict=True)
    )
    return pan, tilt
