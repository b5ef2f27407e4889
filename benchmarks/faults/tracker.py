"""A tracker in a separate process, with faults: `... -m benchmarks.faults.tracker FAULT PORT SECONDS`.

It sends lines by UDP; for faults of long lines it serves them by TCP.
"""

from __future__ import annotations

import contextlib
import json
import select
import socket
import sys
import time

import numpy as np

from gazempc.types import FloatArray

RATE_HZ, LATENCY_S = 30.0, 0.05
TCP_FAULTS = ("long_lines", "lines_without_end")
_LONG_LINE, _LONG_EVERY_S = 950_000, 0.1
_STRANGER_AFTER_S = 0.3
# Periodic path of the person across the robot's view.
_RANGE_M, _HALF_WAY_M, _PERIOD_S = 2.5, 1.2, 6.0
_IMPOSSIBLE_M = ([0.0, 0.0, 0.0], [1e9, 0.0, 0.0], [3.0, 0.0, -9.0])


def head_m(times_s: FloatArray) -> FloatArray:
    """Position of the person's head in the base frame.

    Args:
        times_s: Times on any clock, shape (H,), seconds.

    Returns:
        Shape (H, 3), metres.
    """
    phase = 2.0 * np.pi * np.asarray(times_s) / _PERIOD_S
    return np.stack([_RANGE_M + 0.3 * np.sin(0.5 * phase), _HALF_WAY_M * np.sin(phase), 0.4 + 0.0 * phase], axis=-1)


def line(captured_s: float, stamp_s: float, place_m: list[float] | None = None) -> bytes:
    """Line with the observation at a time, with a given time stamp."""
    seen_m = head_m(np.array([captured_s]))[0].round(4).tolist() if place_m is None else place_m
    return json.dumps({"capture_time_s": stamp_s, "head_position_m": seen_m}).encode("ascii") + b"\n"


def lines_of(fault: str, began_s: float, now_s: float, frame: int) -> bytes:
    """Lines that the tracker sends at a frame."""
    captured_s = now_s - LATENCY_S
    stamp_s = {
        "clock_ahead": captured_s + 0.1,
        "clock_fast": captured_s + 0.03 * (now_s - began_s),
        "clock_behind": captured_s - 5.0,
    }.get(fault, captured_s)
    place_m = _IMPOSSIBLE_M[frame % len(_IMPOSSIBLE_M)] if fault == "impossible_heads" and frame % 2 else None
    return line(captured_s, stamp_s, place_m)


def strange(now_s: float, frame: int) -> bytes:
    """Forged observations: another person on the opposite side, with the newest capture time."""
    return b'{"age_s": 0.0, "head_position_m": [2.0, %.1f, 0.4]}\n' % (2.0 if frame % 60 < 30 else -2.0)


def send(fault: str, port: int, seconds: float) -> None:
    """Send by UDP for a duration in seconds."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        rate_hz = 1000.0 if fault in ("flood", "strange_flood") else 60.0 if fault == "stranger" else RATE_HZ
        every = round(rate_hz / RATE_HZ)
        print("ready", flush=True)
        began_s, strange_from_s = time.time(), None
        for frame in range(int(seconds * rate_hz)):
            time.sleep(max(0.0, began_s + frame / rate_hz - time.time()))
            now_s, to = time.time(), ("127.0.0.1", port)
            if fault in ("stranger", "strange_flood"):
                # Attack only after the start of the run, announced by a line: the first sender must be the tracker.
                if strange_from_s is None and select.select([sys.stdin], [], [], 0.0)[0]:
                    strange_from_s = now_s + _STRANGER_AFTER_S
                if strange_from_s is not None and now_s > strange_from_s:
                    other.sendto(strange(now_s, frame), to)
                if frame % every:
                    continue
            own.sendto(lines_of(fault, began_s, now_s, frame), to)


def serve(fault: str, port: int, seconds: float) -> None:
    """Serve one client by TCP for a duration in seconds."""
    with socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        server.bind(("127.0.0.1", port))
        server.listen()
        print("ready", flush=True)
        connection, _ = server.accept()
        began_s, long_s = time.time(), 0.0
        end = b"\n" if fault == "long_lines" else b""
        with connection:
            for frame in range(int(seconds * RATE_HZ)):
                time.sleep(max(0.0, began_s + frame / RATE_HZ - time.time()))
                now_s = time.time()
                connection.sendall(b"\n" + lines_of(fault, began_s, now_s, frame))
                if now_s - long_s > _LONG_EVERY_S:
                    connection.sendall(b'{"head_position_m": [' + b"1, " * (_LONG_LINE // 3) + b"]}" + end)
                    long_s = now_s


def main(fault: str, port: str, seconds: str) -> None:
    """Run the process."""
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # the run is over
        (serve if fault in TCP_FAULTS else send)(fault, int(port), float(seconds))


if __name__ == "__main__":
    main(*sys.argv[1:])
