"""Model error at the stability limit of a neck, simulated: `python -m experiments.swing --necks reference reachy_mini`.

MPC, observer, smoother and simulated neck in closed loop, with a person at rest and a small initial error, so that no
limit is active. Bisection finds the error of gain or dead time beyond which the oscillation of the pan grows. The table
compares it with `gazempc margins`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

import numpy as np
from pydantic import Field

import gazempc as gz
from experiments.engine.command import Command
from gazempc.loop.drive import Drive
from gazempc.loop.observer import JointObserver
from gazempc.loop.smoother import Smoother
from gazempc.margins.linear_loop import Mismatch
from gazempc.margins.margins import Margins, margins
from gazempc.neck.ahead import joints_after_dead_time
from gazempc.neck.spec import AXES, neck_names
from gazempc.settings import Settings
from gazempc.sim.simulated import SimulatedNeck
from gazempc.types import FloatArray

_START_RAD = math.radians(0.05)
# A distant person, for whom a few millimetres of lateral offset are negligible.
_PERSON_M = np.array([2.5, 0.0, 0.0])
_PERIODS, _LEAST_S = 18.0, 6.0
_BISECTIONS = 6


class SwingSettings(Settings):
    """Settings of `python -m experiments.swing`."""

    necks: tuple[str, ...] = Field(default=neck_names(), description="Shipped necks or .toml files")


def simulate(neck: gz.NeckSpec, error: Mismatch, duration_s: float) -> FloatArray:
    """Pan angle in closed loop, one value per servo period, radians.

    Args:
        neck: Model of the controller.
        error: Model mismatch of the simulated neck.
        duration_s: Simulated time, seconds.
    """
    mpc, now_s, h = gz.Mpc(neck), 0.0, neck.servo_period_s
    start_rad = np.zeros(neck.joints)
    start_rad[0] = _START_RAD
    observer, smoother = JointObserver(neck, start_rad, 0.0), Smoother(neck, start_rad)
    drive, after_dead_time = Drive(neck, start_rad), joints_after_dead_time(neck, 0)
    differs = neck.model_copy(update={name: error.of(getattr(neck, name)) for name in AXES})
    robot = SimulatedNeck(differs, start_rad, lambda: now_s)
    robot.connect()
    sent = np.tile(start_rad, (2 + math.ceil(float(neck.dead_time_s.max()) / h), 1))
    acts, none, plan = start_rad, np.zeros((0, neck.joints)), None
    found = []
    for tick in range(round(duration_s / h)):
        now_s = tick * h
        observer.update(now_s, robot.read_state())
        joints = observer.estimate
        if tick % neck.servo_ticks_per_plan == 0:
            times_s = mpc.forecast_times_s(now_s, now_s)
            forecast = gz.Forecast(
                times_s, np.tile(_PERSON_M, (times_s.size, 1)), np.zeros((times_s.size, 3, 3)), now_s
            )
            seen, offset_rad = drive.for_controllers(sent, joints.offset_rad)
            state = joints.position_rad, joints.velocity_rad_s, offset_rad, seen, none
            plan = mpc.plan(gz.Situation(after_dead_time, now_s, forecast, smoother.command, *state))
        wanted = smoother.step(now_s, plan)
        if neck.takes_speeds:
            wanted = drive.outgoing(smoother.motions, joints.offset_rad, math.inf)
        acts, scaled = wanted, wanted.copy()
        scaled[: len(AXES)] *= error.gain
        robot.send_command(scaled)
        observer.sent(acts)
        sent = np.roll(sent, -1, axis=0)
        sent[-1] = drive.sent(acts)
        found.append(float(robot.true_state().position_rad[0]))
    return np.array(found)


def swings(neck: gz.NeckSpec, error: Mismatch, period_s: float) -> bool:
    """Whether an oscillation of about this period, seconds, grows."""
    duration_s = max(_PERIODS * period_s, _LEAST_S)
    pan_rad = simulate(neck, error, duration_s)
    # The first third is a transient of all modes; then the slowest one dominates. Fast growth saturates at the limits.
    _, middle, last = np.array_split(pan_rad, 3)
    return bool(np.ptp(last) > min(np.ptp(middle), 4.0 * _START_RAD))


def critical(neck: gz.NeckSpec, error: Callable[[float], Mismatch], theory: float, period_s: float) -> float:
    """Model error at the simulation's stability limit, by bisection between 0.75 and 1.35 times the theory."""
    low, high = 0.75 * theory, 1.35 * theory
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if swings(neck, error(middle), period_s) else (middle, high)
    return 0.5 * (low + high)


def compare(neck: gz.NeckSpec) -> tuple[Margins, float, float]:
    """Margins of the pan, and the critical gain and delay, seconds, of the simulation."""
    pan = margins(gz.Mpc(neck))[0]
    crossing_s = 2.0 * math.pi / (math.radians(pan.phase_deg) / pan.delay_s)
    gain = critical(neck, lambda x: Mismatch(gain=x), pan.gain, 1.0 / pan.gain_hz)
    return pan, gain, critical(neck, lambda x: Mismatch(dead_time_s=x), pan.delay_s, crossing_s)


def _work(settings: SwingSettings, _: str) -> int:
    print(f"{'neck':<17} {'gain margin':>12} {'simulated':>10} {'delay margin [ms]':>18} {'simulated':>10}")
    for name in settings.necks:
        neck = gz.load_neck(name)
        pan, gain, delay_s = compare(neck)
        row = f"{pan.gain:>12.2f} {gain:>10.2f} {1e3 * pan.delay_s:>18.0f} {1e3 * delay_s:>10.0f}"
        print(f"{neck.name:<17} {row}", flush=True)
    return 0


main = Command("swing", SwingSettings, __doc__, _work).main

if __name__ == "__main__":
    sys.exit(main())
