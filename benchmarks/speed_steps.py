"""Dithered against rounded speeds of a camera with VISCA: `python -m benchmarks.speed_steps`.

Live runs in real time with the emulated VISCA camera (simulated neck `ptz`, dead time 0.3 s) before two walks made by
the generator. The device has 24 and 20 equal speeds, or those of a cheap maker, twelve below 6 deg/s: three minutes.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gazempc.live.process import fast_switching
from gazempc.live.run import LiveRun
from gazempc.live.session import parse
from gazempc.live.setup import build
from gazempc.neck.kinematics import look_at_rad
from gazempc.neck.spec import Axis, NeckSpec, load_neck
from gazempc.neck.speed_steps import SpeedDither, SpeedSteps
from gazempc.results.log import Log
from gazempc.robots.options import ViscaOptions
from gazempc.robots.visca import ViscaCamera
from gazempc.robots.visca_server import ViscaServer
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import FloatArray

_CHEAP = (0.3, 0.6, 1, 1.3, 1.7, 2.1, 2.6, 3.1, 3.7, 4.4, 5.2, 6, 9, 15, 19, 25, 32, 40, 48, 56, 62, 68, 74, 80)
_WALKS = ("subject03_R4", "subject09_R6")
_RUNS = 2
_SETTLED_S = 2.0


def _rounded(dither: SpeedDither, wanted_rad_s: float, _: float) -> float:
    dither.held_rad_s = min(dither._levels, key=lambda level: abs(level - wanted_rad_s))
    return dither.held_rad_s


def _cheap(axis: Axis, count: int) -> Axis:
    speeds = tuple((np.array(_CHEAP[:count]) * axis.velocity_max_rad_s / _CHEAP[count - 1] * 1.0001).tolist())
    return axis.model_copy(update={"speed_steps": SpeedSteps(positive_rad_s=speeds, negative_rad_s=speeds)})


def _run(neck: NeckSpec, walk: str) -> tuple[float, float, float]:
    """Gaze error RMS in degrees, acceleration RMS of pan in rad/s^2, and commands a minute."""
    setup = build(parse(["--source", "replay", "--replay", walk, "--neck", "ptz", "--no-figures"]))
    lock, plant = threading.Lock(), SimulatedNeck(neck, neck.rest_rad, setup.clock.now_s)
    plant.connect()
    server = ViscaServer(plant, neck, lock)
    host, port = server.address
    robot = ViscaCamera(f"{host}:{port}", neck, setup.clock.now_s, ViscaOptions())
    logs: list[Log] = []
    run = LiveRun(replace(setup, neck=neck, robot=robot), lambda log, _: logs.append(log))
    rows: list[tuple[float, float, float]] = []
    done = threading.Event()

    def sample() -> None:
        while not done.wait(0.01):
            with lock:
                state = plant.true_state()
            rows.append((state.time_s, *state.position_rad.tolist()))

    sampler = threading.Thread(target=sample)
    sampler.start()
    with fast_switching():
        run.run(threading.Event())
    done.set()
    sampler.join()
    server.close()
    return _figures(neck, logs[0], np.array(rows), len(server.driven))


def _figures(neck: NeckSpec, log: Log, rows: FloatArray, driven: int) -> tuple[float, float, float]:
    known = np.isfinite(log.head_true_base_m).all(axis=1) & (log.time_s > log.time_s[0] + _SETTLED_S)
    wanted = np.array([look_at_rad(neck.geometry, head_m) for head_m in log.head_true_base_m[known]])
    found = np.stack([np.interp(log.time_s[known], rows[:, 0], rows[:, k]) for k in (1, 2)], axis=1)
    error_deg = float(np.rad2deg(np.sqrt(np.mean(np.sum((found - wanted) ** 2, axis=1)))))
    period_s = 0.05
    pan = np.interp(np.arange(rows[0, 0], rows[-1, 0], period_s), rows[:, 0], rows[:, 1])
    acceleration = float(np.sqrt(np.mean((np.diff(pan, 2) / period_s**2) ** 2)))
    return error_deg, acceleration, 60.0 * driven / float(rows[-1, 0] - rows[0, 0])


def main() -> None:
    """Measure and print."""
    equal = load_neck("ptz")
    cheap = equal.model_copy(update={"pan": _cheap(equal.pan, 24), "tilt": _cheap(equal.tilt, 20)})
    dithered: Callable[[SpeedDither, float, float], float] = SpeedDither.choose
    print("speeds  walk          choice    error [deg]  acceleration [rad/s2]  commands/min")
    for name, neck in (("equal", equal), ("cheap", cheap)):
        for walk in _WALKS:
            for choice, choose in (("dithered", dithered), ("rounded", _rounded)):
                SpeedDither.choose = choose  # type: ignore[method-assign, assignment]
                figures = np.mean([_run(neck, walk) for _ in range(_RUNS)], axis=0)
                print(
                    f"{name:<7} {walk:<13} {choice:<9} {figures[0]:11.2f} {figures[1]:22.2f} {figures[2]:13.0f}",
                    flush=True,
                )
                time.sleep(0.2)


if __name__ == "__main__":
    main()
