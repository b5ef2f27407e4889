"""Modules with parts of a user's own, written into a folder as a user has them in the working directory."""

import itertools

PREDICTOR = '''
import numpy as np
import gazempc as gz

class Standing:
    """Forecasts that the head stays where it was seen last."""

    def __init__(self, noise_m: float = 0.01, person: str = ""):
        self.noise_m, self.person, self.last = noise_m, person, None

    def reset(self):
        self.last = None

    def update(self, observation):
        self.last = observation

    def forecast(self, times_s):
        count = len(times_s)
        return gz.Forecast(
            times_s=times_s,
            means_base_m=np.tile(self.last.head_position_base_m, (count, 1)),
            covariances_m2=np.tile(self.noise_m**2 * np.eye(3), (count, 1, 1)),
            issued_at_s=self.last.capture_time_s,
        )
'''
CONTROLLER = """
import gazempc as gz

class Eager(gz.Reactive):
    def __init__(self, neck, gain: float = 1.0):
        super().__init__(neck)
        self.gain = gain

class WrongPlan(gz.Reactive):
    def plan(self, situation):
        return None
"""
ROBOT = '''
import numpy as np
from gazempc.sim.simulated import SimulatedNeck

class Head(SimulatedNeck):
    """Stands for a driver; has the loop's clock and the neck's limits."""
    def __init__(self, neck, clock_s, position_rad, zero_deg: tuple[float, float] = (0.0, 0.0)):
        super().__init__(neck, position_rad, clock_s)
        self.zero_deg = zero_deg

class RealHead(Head):
    keeps_any_clock = False

class LackingRobot:
    keeps_any_clock = True
    def connect(self): ...
    def read_state(self): ...
    def close(self): ...

class RaisingRobot(Head):
    def __init__(self, port: str):
        raise OSError(f"no device at {port}")
'''
SOURCE = '''
import gazempc as gz
from gazempc.live.sources.source import Arrived
from gazempc.types import Sighting

class Walker:
    """A person walks by at some speed for four seconds, seen at 30 frames a second."""

    keeps_any_clock = True

    def __init__(self, clock, speed_m_s: float = 0.5):
        self.clock, self.speed_m_s, self.frame = clock, speed_m_s, 0

    def open(self):
        self.start_s = self.clock.now_s()

    def poll(self):
        arrived = []
        while (captured_s := self.start_s + self.frame / 30.0) <= self.clock.now_s() - 0.05:
            head_m = [2.0, self.speed_m_s * (self.frame / 30.0 - 2.0), 0.3]
            arrived.append(Sighting(captured_s + 0.05, gz.HeadObservation(captured_s, head_m)))
            self.frame += 1
        return Arrived(tuple(arrived))

    @property
    def finished(self):
        return self.frame >= 120

    def close(self): ...
'''
_NUMBERS = itertools.count()


def write_own_parts(folder):
    """Write all of it into a folder; each call gives another module, because Python imports a name once.

    Returns the module's name.
    """
    name = f"own_parts_{next(_NUMBERS)}"
    (folder / f"{name}.py").write_text(PREDICTOR + CONTROLLER + ROBOT + SOURCE, encoding="utf-8")
    return name
