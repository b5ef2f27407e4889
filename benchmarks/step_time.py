"""How long one tick takes: `python -m benchmarks.step_time`.

Each stage is timed in process CPU time over one replay's worth of calls on the synthetic walk subject03_R4. Absolute
times depend on the machine; the last column is the ratio to a bare constant-velocity step of filterpy in the same run.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import tyro
from filterpy.kalman import KalmanFilter

from gazempc.controllers.controller import Controller, Situation
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.reactive import Reactive
from gazempc.loop.smoother import Smoother
from gazempc.neck.ahead import settled_joints
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.sim.sensor import load_sensor, observe
from predictors import ConstantVelocity, HeadPose, Predictor, Walker
from predictors.constant_velocity import process_noise, transition


def cpu_ms(call: Callable[[], object]) -> float:
    """CPU time of one call, milliseconds."""
    started_s = time.process_time()
    call()
    return 1e3 * (time.process_time() - started_s)


def bare_kalman_step() -> list[float]:
    """Predict and update by filterpy of a constant-velocity model, no gating, fixed matrices."""
    kf = KalmanFilter(dim_x=6, dim_z=3)
    kf.x = np.zeros(6)
    kf.F, kf.Q = transition(1 / 30), process_noise(1 / 30, 0.05)
    kf.H = np.hstack([np.eye(3), np.zeros((3, 3))])
    z = np.array([2.0, 0.0, 0.4])

    def step() -> None:
        kf.predict()
        kf.update(z)

    return [cpu_ms(step) for _ in range(500)]


def main(repeats: int = 3, horizons_s: tuple[float, ...] = (0.4, 0.8, 1.6)) -> None:
    """Time all stages and print a table.

    Args:
        repeats: How many times the walk is gone through.
        horizons_s: Horizons of the MPC to show how its step grows.
    """
    neck = load_neck("reference")
    placed = place(load("subject03_R4"), "recorded", 2.5, 1.2)
    sightings = observe(placed, load_sensor("reference"), seed=0)
    found: dict[str, list[float]] = {"filterpy constant velocity, bare": bare_kalman_step()}
    controllers: dict[str, Controller] = {"reactive step": Reactive(neck), "look-ahead step": LookAhead(neck)}
    for horizon_s in horizons_s:
        controllers[f"MPC step, N = {round(horizon_s / neck.control_period_s)}"] = Mpc(neck, horizon_s)
    ahead_s = np.linspace(0.4, 1.2, 40)
    for _ in range(repeats):
        predictors: dict[str, Predictor] = {
            "constant_velocity": ConstantVelocity(),
            "head_pose": HeadPose(),
            "walker": Walker(),
        }
        for name, predictor in predictors.items():
            smoother = Smoother(neck, np.zeros(2))
            for sighting in sightings:
                observation, now_s = sighting.observation, sighting.arrival_s
                update_ms = cpu_ms(lambda p=predictor, o=observation: p.update(o))  # type: ignore[misc]
                forecast_ms = cpu_ms(lambda p=predictor, t=now_s: p.forecast(t + ahead_s))  # type: ignore[misc]
                found.setdefault(f"{name}: update", []).append(update_ms)
                found.setdefault(f"{name}: forecast, 40 points", []).append(forecast_ms)
                found.setdefault(f"{name}: both", []).append(update_ms + forecast_ms)
                if name != "constant_velocity":
                    continue
                for label, controller in controllers.items():
                    situation = Situation(
                        settled_joints(neck, 0),
                        start_s=now_s,
                        forecast=predictor.forecast(controller.forecast_times_s(now_s, observation.capture_time_s)),
                        command=smoother.command,
                        joint_position_rad=smoother.command.position_rad,
                        joint_velocity_rad_s=smoother.command.velocity_rad_s,
                        joint_offset_rad=np.zeros(2),
                        sent_rad=np.tile(smoother.command.position_rad, (100, 1)),
                        committed_rad=np.zeros((0, 2)),
                    )
                    found.setdefault(label, []).append(
                        cpu_ms(lambda c=controller, s=situation: c.plan(s))  # type: ignore[misc]
                    )
                    plan = controller.plan(situation)
                for k in range(7):
                    tick_s = now_s + k * neck.servo_period_s
                    found.setdefault("smoother, one command", []).append(
                        cpu_ms(lambda s=smoother, t=tick_s, p=plan: s.step(t, p))  # type: ignore[misc]
                    )
    unit = float(np.median(found["filterpy constant velocity, bare"]))
    print(f"{'CPU time [ms]':<36}{'median':>9}{'p99':>9}{'calls':>8}{'ratio':>8}")
    for name, values in found.items():
        median = float(np.median(values))
        print(f"{name:<36}{median:>9.3f}{np.percentile(values, 99):>9.3f}{len(values):>8}{median / unit:>8.1f}")


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.step_time", description=__doc__)
