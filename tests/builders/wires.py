"""Lines of observations, a scripted wire, and a collector."""

import json
import socket

from builders.waiting import FOREVER_S, wait_for
from gazempc.live.clock import RealClock
from gazempc.live.sources.wires import Chunk


def line(k, **other):
    return json.dumps({"age_s": 0.01, "head_position_m": [2.0, 0.001 * k, 0.4]} | other).encode() + b"\n"


def numbers(sightings):
    return [round(1000 * s.observation.head_position_base_m[1]) for s in sightings]


class Collector:
    """Polls a source until a condition holds."""

    def __init__(self, source):
        self.source, self.sightings, self.cues, self.problems, self.notices = source, [], [], [], []

    def until(self, done):
        def polled():
            arrived = self.source.poll()
            self.sightings += arrived.sightings
            self.cues += arrived.cues
            self.problems += arrived.problems
            self.notices += arrived.notices
            return done(self)

        wait_for(polled, FOREVER_S, why=lambda: f"{numbers(self.sightings)}, {self.problems}")
        return self


class Scripted:
    """A wire that returns prepared chunks; at the end None or OSError."""

    name = "a wire"

    def __init__(self, chunks, end=None):
        self.chunks, self.end, self.closed = list(chunks), end, 0

    def open(self):
        pass

    def read(self):
        if self.chunks:
            chunk = self.chunks.pop(0)
            return [chunk if isinstance(chunk, Chunk) else Chunk(chunk)]
        if self.end is not None:
            raise self.end
        return None

    def close(self):
        self.closed += 1


class SteppedClock(RealClock):
    """The real clock with a step set by a test."""

    ahead_s = 0.0

    def now_s(self):
        return super().now_s() + self.ahead_s


def serve(port):
    server = socket.create_server(("127.0.0.1", port))
    server.settimeout(FOREVER_S)
    return server
