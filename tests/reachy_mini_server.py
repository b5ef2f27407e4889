"""An emulated websocket of Reachy Mini's daemon: it sends frames recorded from the real one."""

import json
import socket
import threading
import time
from contextlib import contextmanager
from pathlib import Path

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

RECORDED = json.loads((Path(__file__).parent / "data" / "reachy_mini_frames.json").read_text(encoding="utf-8"))


def recorded(direction, kind):
    """(time in seconds, message) of all recorded frames of a kind, in order."""
    return [(t, m) for d, t, m in RECORDED["frames"] if d == direction and m["type"] == kind]


class Daemon:
    """Sends its frames at 50 Hz, and records received messages."""

    def __init__(self):
        kinds = ("daemon_status", "joint_positions", "head_pose")
        self.frames = {kind: recorded("received", kind)[0][1] for kind in kinds}
        self.extra = []
        self.received = []
        self.silent = False
        self.deaf = threading.Event()
        self._connections = set()
        self._stopped = threading.Event()
        self._port = 0
        self.start()

    @property
    def port(self):
        return self._port

    def start(self):
        self._stopped.clear()
        self._server = serve(self._handle, "127.0.0.1", self._port, compression=None)
        # Small, so that a daemon that reads nothing is detected soon.
        self._server.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
        self._port = self._server.socket.getsockname()[1]
        self._thread = threading.Thread(target=self._server.serve_forever)
        self._thread.start()

    def stop(self):
        """Close the port."""
        self._stopped.set()
        self.deaf.clear()
        self._server.shutdown()
        self._thread.join()
        for connection in list(self._connections):
            connection.close()

    def commands(self):
        """All messages received so far, after a moment without a new one."""
        deadline = time.monotonic() + 10
        last = -1
        while time.monotonic() < deadline and last != (last := len(self.received)):
            time.sleep(0.05)
        return list(self.received)

    def _handle(self, connection):
        self._connections.add(connection)
        sender = threading.Thread(target=self._stream, args=(connection,))
        sender.start()
        try:
            for message in connection:
                self.received.append(json.loads(message))
                while self.deaf.is_set():
                    time.sleep(0.01)
        except ConnectionClosed:
            pass
        finally:
            self._connections.discard(connection)
            sender.join()

    def _stream(self, connection):
        try:
            while not self._stopped.is_set():
                if not self.silent:
                    for frame in [*self.extra, *self.frames.values()]:
                        connection.send(frame if isinstance(frame, (str, bytes)) else json.dumps(frame))
                time.sleep(0.02)
        except ConnectionClosed:
            pass


@contextmanager
def daemon():
    server = Daemon()
    try:
        yield server
    finally:
        server.stop()
