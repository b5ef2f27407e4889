"""Dynamixel X motors on a pseudo-terminal, written from the manual of protocol 2.0 alone."""

import os
import select
import struct
import threading
import tty

PING, STATUS, SYNC_READ, SYNC_WRITE = 0x01, 0x55, 0x82, 0x83
BROADCAST = 0xFE
HEADER = b"\xff\xff\xfd\x00"

# Control table of an X motor: address, bytes, writable. Other accesses are errors.
ITEMS = {
    "model": (0, 2, False),
    "mode": (11, 1, True),
    "max_position": (48, 4, True),
    "min_position": (52, 4, True),
    "torque": (64, 1, True),
    "led": (65, 1, True),
    "status_return_level": (68, 1, True),
    "registered": (69, 1, False),
    "hardware_error": (70, 1, False),
    "profile_acceleration": (108, 4, True),
    "profile_velocity": (112, 4, True),
    "goal": (116, 4, True),
    "velocity": (128, 4, False),
    "position": (132, 4, False),
}
DEFINED = {a for address, size, _ in ITEMS.values() for a in range(address, address + size)}
EEPROM_END = 64


def crc16(data):
    """CRC-16 with polynomial 0x8005, initial value 0, most significant bit first."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        crc &= 0xFFFF
    return crc


def packet(motor_id, instruction, payload=b""):
    """One packet: byte stuffing, then length and CRC of the stuffed bytes."""
    body = (bytes([instruction]) + payload).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    head = HEADER + bytes([motor_id]) + struct.pack("<H", len(body) + 2)
    return head + body + struct.pack("<H", crc16(head + body))


def take_packet(buffer):
    """Take the first whole packet out of a bytearray: (id, instruction, parameters), or None if there is none yet."""
    while True:
        start = buffer.find(HEADER)
        if start < 0 or len(buffer) < start + 7:
            return None
        length = struct.unpack_from("<H", buffer, start + 5)[0]
        end = start + 7 + length
        if len(buffer) < end:
            return None
        whole = bytes(buffer[start:end])
        del buffer[:end]
        if struct.unpack("<H", whole[-2:])[0] == crc16(whole[:-2]):
            body = whole[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            return whole[4], body[0], body[1:]


class Motor:
    """A control table and a joint that moves half of the way to its goal at every new goal."""

    def __init__(self, position, mode=3):
        self.table = bytearray(256)
        self.history = []
        self.answers = True
        for name, value in {"model": 1020, "mode": mode, "max_position": 4095}.items():
            self.set(name, value)
        self.restart(position)

    def get(self, name):
        address, size, _ = ITEMS[name]
        return int.from_bytes(self.table[address : address + size], "little", signed=size == 4)

    def set(self, name, value):
        address, size, _ = ITEMS[name]
        self.table[address : address + size] = value.to_bytes(size, "little", signed=size == 4)

    def restart(self, position):
        """Power on: factory RAM, torque off, joint at the given position."""
        self.table[EEPROM_END:] = bytes(256 - EEPROM_END)
        self.set("profile_velocity", 77)
        self.set("goal", 0)
        self.set("position", position)

    def read(self, address, size):
        if any(a not in DEFINED for a in range(address, address + size)):
            return 0x07, b""
        return 0, bytes(self.table[address : address + size])

    def write(self, address, data):
        end = address + len(data)
        hit = {name: item for name, item in ITEMS.items() if address <= item[0] and item[0] + item[1] <= end}
        if sum(size for _, size, _ in hit.values()) != len(data) or not all(item[2] for item in hit.values()):
            return 0x07
        if address < EEPROM_END and self.get("torque"):
            return 0x07
        new = {name: data[item[0] - address : item[0] - address + item[1]] for name, item in hit.items()}
        if "goal" in new and self.get("mode") == 3:
            goal = struct.unpack("<i", new["goal"])[0]
            if not self.get("min_position") <= goal <= self.get("max_position"):
                return 0x06
        for name, value in new.items():
            if name == "torque" and value[0] and self.get("hardware_error"):
                return 0x01
            self.table[ITEMS[name][0] : ITEMS[name][0] + len(value)] = value
        if "torque" in new and new["torque"][0]:
            if self.get("mode") == 3:
                self.set("position", self.get("position") % 4096)
            self.history.append(("torque on", self.get("goal") - self.get("position")))
        if "goal" in new and self.get("torque"):
            self.history.append(("goal", self.get("goal")))
            way = self.get("goal") - self.get("position")
            self.set("position", self.get("position") + int(way / 2) if abs(way) > 1 else self.get("goal"))
            self.set("velocity", int(way / 2))
        return 0


class Bus:
    """Motors by id, behind a link with a persistent name, as by a udev rule.

    `fault` is called with each answer's (motor id, bytes) and gives the bytes to send instead.
    """

    def __init__(self, link, motors):
        self.link, self.motors, self.fault = link, motors, None
        self.received = []
        self.lock = threading.Lock()
        self._thread = None
        self.plug_in()

    def plug_in(self):
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.link.symlink_to(os.ttyname(self._slave))
        self._wake_read, self._wake_write = os.pipe()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def unplug(self):
        if self._thread is None:
            return
        os.write(self._wake_write, b"x")
        self._thread.join()
        self._thread = None
        for fd in (self._master, self._slave, self._wake_read, self._wake_write):
            os.close(fd)
        self.link.unlink()

    def _run(self):
        buffer = bytearray()
        while True:
            ready, _, _ = select.select([self._master, self._wake_read], [], [])
            if self._wake_read in ready:
                return
            buffer += os.read(self._master, 4096)
            while (taken := take_packet(buffer)) is not None:
                with self.lock:
                    self.received.append(taken)
                    for motor_id, answer in self._answers(*taken):
                        self._send(self.fault(motor_id, answer) if self.fault else answer)

    def _send(self, data):
        try:
            while data:
                data = data[os.write(self._master, data) :]
        except BlockingIOError:
            pass  # no reader: the bytes are lost, as on a wire

    def _answers(self, motor_id, instruction, parameters):
        def status(i, error, data=b""):
            alert = 0x80 if self.motors[i].get("hardware_error") else 0
            return i, packet(i, STATUS, bytes([error | alert]) + data)

        on_line = {i: motor for i, motor in self.motors.items() if motor.answers}
        if instruction == PING and motor_id in on_line:
            yield status(motor_id, 0, on_line[motor_id].table[0:2] + b"\x2e")
        elif instruction in (SYNC_READ, SYNC_WRITE) and motor_id == BROADCAST:
            address, size = struct.unpack_from("<HH", parameters)
            rest = parameters[4:]
            if instruction == SYNC_READ:
                for i in rest:
                    if i in on_line:
                        yield status(i, *on_line[i].read(address, size))
            else:
                for k in range(0, len(rest), size + 1):
                    if rest[k] in on_line:
                        on_line[rest[k]].write(address, rest[k + 1 : k + 1 + size])
