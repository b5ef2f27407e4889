"""A robot for `gazempc.Gaze`."""

import math
import threading
import time
from types import SimpleNamespace

import numpy as np

from builders.checks import assert_within_limits
from builders.live import NECK
from builders.robots import Spied
from gazempc.sim.simulated import SimulatedNeck

START_RAD = np.radians([5.0, 2.0])


class Robot(Spied):
    """A simulated neck on the computer's clock; records the commands."""

    name = "spied"

    def __init__(self):
        self.threads = set()
        clock = SimpleNamespace(now_s=time.monotonic)
        super().__init__(SimulatedNeck(NECK, START_RAD, time.monotonic), clock, on_send=self.note_thread)

    def note_thread(self, _):
        self.threads.add(threading.current_thread().name)

    @property
    def sent(self):
        return [position_rad for _, position_rad in self.received]


def assert_braked_and_closed(robot):
    """Every command within limits, the last one at rest, the robot closed once."""
    assert robot.calls == ["connect", "close"]
    sent = np.array(robot.sent)
    assert_within_limits(sent, START_RAD, ends=True)
    return sent


def see_for(opened, seconds, stamp=time.time):
    """Feed a passing person at 30 Hz."""
    start_s = time.monotonic()
    while (elapsed_s := time.monotonic() - start_s) < seconds:
        opened.see(stamp() - 0.03, [2.0, 1.2 * math.sin(1.5 * elapsed_s), 0.3], head_quat_wxyz=[1, 0, 0, 0])
        time.sleep(1 / 30)


def moves(robot):
    return len(robot.sent) > 1 and np.abs(np.diff(robot.sent[-2:], axis=0)).max() > 1e-4
