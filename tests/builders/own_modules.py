"""Modules with user-defined parts, written into a working directory."""

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
    """Write the modules into a folder; each call uses a new module name, because Python imports a name once.

    Returns the module's name.
    """
    name = f"own_parts_{next(_NUMBERS)}"
    (folder / f"{name}.py").write_text(PREDICTOR + CONTROLLER + ROBOT + SOURCE, encoding="utf-8")
    return name


CAMERA = """
import time
import numpy as np
from skimage import data

PORTRAIT = data.astronaut()[:384, 90:360]

class Empty:
    def read(self):
        time.sleep(0.02)
        return np.zeros((480, 640, 3), np.uint8), time.monotonic()

    def close(self):
        pass

class Row(Empty):
    '''People side by side, 20 times a second, each picture captured 50 ms before it is there; then it breaks.'''

    count = 0

    def __init__(self, people: int):
        # 0.4 m from face to face, at 1 m.
        self.picture = np.hstack([PORTRAIT, PORTRAIT[:, ::-1], PORTRAIT][:people])

    def read(self):
        self.count += 1
        if self.count > 12:
            raise OSError("the cable was pulled")
        captured_s = time.monotonic()
        time.sleep(0.05)
        return self.picture, captured_s

class Grey(Empty):
    def read(self):
        return np.zeros((480, 640)), time.monotonic()
"""


def write_own_camera(folder, monkeypatch):
    """Write the module `portrait_camera` into a folder that becomes the working directory."""
    (folder / "portrait_camera.py").write_text(CAMERA)
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(folder)


_SPOILT = """
from benchmarks.faults.wrongs import FAMILIES
from {module} import {base}
KINDS = [change for name, change in FAMILIES["{family}"].items() if name not in ("blocks for 1 s", "15 ms each")]

class Spoilt({base}):
    calls = 0

    def spoilt(self, *args):
        self.calls += 1
        answer = super().{method}(*args) if "{method}" != "finished" else super().finished
        spoils = self.calls > {good_calls}
        return KINDS[self.calls // 2 % len(KINDS)](answer) if spoils else answer

    {method} = {wrap}(spoilt)
"""
_SPOILT_BASES = {"Robot": "Head", "Source": "Walker", "Controller": "Reactive", "Predictor": "ConstantVelocity"}


def write_spoilt(folder, family, own):
    """Write a module with the part `Spoilt`, whose answers after the first ones are invalid in different ways."""
    part, method = family.split(".")
    module, wrap = own if part in ("Robot", "Source") else "gazempc", "property" if method == "finished" else ""
    # Closed once; the others are tested when they are built.
    text = _SPOILT.format(
        module=module, base=_SPOILT_BASES[part], family=family, method=method, wrap=wrap,
        good_calls=0 if method == "close" else 40,
    )  # fmt: skip
    name = family.replace(".", "_").lower()
    (folder / f"{name}.py").write_text(text)
    return name


OPENS_AND_IS_KILLED = """
import os, signal
from gazempc.live.clock import RealClock
from gazempc.live.sources.camera.capture import CameraOptions
from gazempc.live.sources.camera.source import CameraSource

if __name__ == "__main__":
    source = CameraSource("portrait_camera:Empty", CameraOptions(), RealClock())
    source.open()
    print(source._process.pid, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""
