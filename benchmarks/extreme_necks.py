"""Is the MPC's plan in time on any neck? `python -m benchmarks.extreme_necks`.

Draws necks from the whole range that a neck file may state (rates from 5 to 1000 plans a second, limits, servos and
dead times over orders of magnitude), and joints, commands and forecasts from anywhere, within the limits and outside.
Counts the plans that took longer than a control period (in CPU time) and those whose solver gave up. Then the plan is
the best one without limits, and the smoother keeps the limits. The first two plans of each neck are not counted:
solvers are set up then, before a run begins.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass

import numpy as np
import tyro
from numpy.random import Generator

from gazempc.controllers.controller import CommandState, Situation
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.neck.ahead import settled_joints
from gazempc.neck.spec import AXES, NeckSpec, load_neck
from predictors import Forecast

# Least and greatest value drawn, on a logarithmic scale; all are accepted by `gazempc.neck.spec`.
_RANGES = {
    "velocity_max_rad_s": (0.01, 30.0),
    "acceleration_max_rad_s2": (0.01, 1000.0),
    "jerk_max_rad_s3": (0.1, 1e5),
    "natural_frequency_rad_s": (0.5, 500.0),
    "damping_ratio": (0.11, 10.0),
    "dead_time_s": (0.001, 5.0),
}
_RATES_HZ = (5.0, 20.0, 50.0, 100.0, 250.0, 500.0, 1000.0)


@dataclass(frozen=True)
class Counts:
    """What became of the plans.

    Attributes:
        plans: How many were counted.
        late: How many took longer than a control period.
        gave_up: In how many a solver gave up.
        not_finite: How many were not finite.
        worst_periods: The slowest plan, control periods.
    """

    plans: int
    late: int
    gave_up: int
    not_finite: int
    worst_periods: float


def random_neck(rng: Generator) -> NeckSpec:
    """A neck of any kind that a file may state."""
    content = load_neck("reference").model_dump()
    for axis in AXES:
        for name, (low, high) in _RANGES.items():
            content[axis][name] = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        content[axis]["position_min_deg"] = float(rng.uniform(-360.0, -0.1))
        content[axis]["position_max_deg"] = float(rng.uniform(0.1, 360.0))
    content["control_rate_hz"] = float(rng.choice(_RATES_HZ))
    content["servo_rate_hz"] = content["control_rate_hz"] * int(rng.integers(1, 5))
    return NeckSpec.model_validate(content)


def random_situation(mpc: Mpc, rng: Generator, scale: float) -> Situation:
    """Joints, command and person anywhere.

    Args:
        mpc: The controller.
        rng: Where numbers are from.
        scale: Size of the command's position, velocity and acceleration, as a share of the limits at most.

    Returns:
        The situation.
    """
    limits, neck = mpc.neck.command_limits, mpc.neck
    times_s = mpc.forecast_times_s(0.0, 0.0)
    means_m = rng.uniform(-4.0, 4.0, 3) + rng.uniform(-2.0, 2.0, 3) * times_s[:, None]
    position_rad = scale * rng.uniform(limits.position_min_rad, limits.position_max_rad)
    history = int(np.ceil(float(neck.dead_time_s.max()) / neck.servo_period_s)) + 2
    return Situation.of(
        settled_joints(neck, 0),
        start_s=0.0,
        forecast=Forecast(times_s, means_m, np.tile(np.eye(3), (times_s.size, 1, 1)), 0.0),
        command=CommandState(
            position_rad,
            scale * rng.uniform(-1.0, 1.0, 2) * limits.velocity_max_rad_s,
            scale * rng.uniform(-1.0, 1.0, 2) * limits.acceleration_max_rad_s2,
        ),
        joint_position_rad=position_rad + rng.normal(0.0, 0.1, 2),
        joint_velocity_rad_s=scale * rng.uniform(-1.0, 1.0, 2) * limits.velocity_max_rad_s,
        joint_offset_rad=rng.normal(0.0, 0.01, 2),
        sent_rad=np.tile(position_rad, (history, 1)),
        committed_rad=np.zeros((0, 2)),
    )


def count(necks: list[NeckSpec], plans: int, rng: Generator) -> Counts:
    """Plan from random situations on each neck.

    Args:
        necks: The necks.
        plans: Situations on each.
        rng: Where numbers are from.

    Returns:
        The counts.
    """
    done = late = gave_up = not_finite = 0
    worst = 0.0
    for neck in necks:
        mpc = Mpc(neck)
        for k in range(plans + 2):
            situation = random_situation(mpc, rng, float(rng.choice([0.3, 0.9, 1.5])))
            started_s = time.process_time()
            plan = mpc.plan(situation)
            periods = (time.process_time() - started_s) / neck.control_period_s
            if k < 2:
                continue
            done += 1
            late += periods > 1.0
            gave_up += "solver_gave_up" in plan.events
            not_finite += not plan.is_finite()
            worst = max(worst, periods)
    return Counts(done, late, gave_up, not_finite, worst)


def main(necks: int = 300, plans: int = 100, seed: int = 0) -> None:
    """Count and print.

    Args:
        necks: How many random necks.
        plans: Plans on each.
        seed: Of the random numbers.
    """
    rng = np.random.default_rng(seed)
    print(f"{necks} random necks:", asdict(count([random_neck(rng) for _ in range(necks)], plans, rng)))
    for name in ("reference", "slow", "reachy_mini", "fetch", "pr2"):
        print(f"{name}:", asdict(count([load_neck(name)], 10 * plans, rng)))


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
