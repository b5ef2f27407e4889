"""Computing time of one tick: `python -m benchmarks.step_time`.

Each stage is timed in process CPU time over one replay's worth of calls on the synthetic walk subject03_R4. Absolute
times depend on the machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import tyro

from gazempc.controllers.controller import Controller, Situation
from gazempc.controllers.lookahead import LookAhead
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.controllers.reactive import Reactive
from gazempc.loop.smoother import Smoother
from gazempc.neck.ahead import joints_after_dead_time
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.sim.sensor import load_sensor, observe
from predictors import ConstantVelocity, HeadPose, Predictor, Walker


def main(repeats: int = 3) -> None:
    """Time all stages and print a table.

    Args:
        repeats: Number of passes over the walk.
    """
    neck = load_neck("reference")
    placed = place(load("subject03_R4"), "recorded", 2.5, 1.2)
    sightings = observe(placed, load_sensor("reference"), seed=0)
    controllers: dict[str, Controller] = {"reactive": Reactive(neck), "look-ahead": LookAhead(neck), "MPC": Mpc(neck)}
    ahead_s = np.linspace(0.4, 1.2, 40)
    found: dict[str, list[float]] = {}

    def timed(name: str, call: Callable[[], object]) -> float:
        started_s = time.process_time()
        call()
        found.setdefault(name, []).append(1e3 * (time.process_time() - started_s))
        return found[name][-1]

    for _ in range(repeats):
        predictors: tuple[Predictor, ...] = (HeadPose(), Walker(), ConstantVelocity())
        for predictor in predictors:
            smoother, name = Smoother(neck, np.zeros(2)), type(predictor).__name__
            for sighting in sightings:
                observation, now_s = sighting.observation, sighting.arrival_s
                update_ms = timed(f"{name}: update", partial(predictor.update, observation))
                forecast_ms = timed(f"{name}: forecast, 40 points", partial(predictor.forecast, now_s + ahead_s))
                found.setdefault(f"{name}: both", []).append(update_ms + forecast_ms)
                if not isinstance(predictor, ConstantVelocity):
                    continue
                for label, controller in controllers.items():
                    situation = Situation(
                        joints_after_dead_time(neck, 0),
                        start_s=now_s,
                        forecast=predictor.forecast(controller.forecast_times_s(now_s, observation.capture_time_s)),
                        command=smoother.command,
                        joint_position_rad=smoother.command.position_rad,
                        joint_velocity_rad_s=smoother.command.velocity_rad_s,
                        joint_offset_rad=np.zeros(2),
                        sent_rad=np.tile(smoother.command.position_rad, (100, 1)),
                        committed_rad=np.zeros((0, 2)),
                    )
                    timed(f"{label}, one plan", partial(controller.plan, situation))
                    plan = controller.plan(situation)
                for k in range(7):
                    timed("smoother, one command", partial(smoother.step, now_s + k * neck.servo_period_s, plan))
    print(f"{'CPU time [ms]':<40}{'median':>9}{'p99':>9}{'calls':>8}")
    for name, values in found.items():
        print(f"{name:<40}{np.median(values):>9.3f}{np.percentile(values, 99):>9.3f}{len(values):>8}")


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.step_time", description=__doc__)
