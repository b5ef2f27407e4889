"""A closed-loop run of the MPC: what its solver has to solve, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.solvers.ours import Gazempc
from benchmarks.solvers.problem import tick_matrices
from benchmarks.solvers.scenario import forecasts
from gazempc.controllers.controller import CommandState, Situation
from gazempc.controllers.mpc.condense import growing_steps
from gazempc.controllers.mpc.ocp import Solution
from gazempc.neck.ahead import settled_joints
from gazempc.neck.kinematics import look_at, unwrap_pan
from gazempc.neck.spec import CommandLimits, NeckSpec
from gazempc.types import FloatArray
from predictors import Forecast

STEPS = 40
SMOOTHING_TIME_S = 0.075
# A limit is reached where this share of it is used.
_REACHED = 1.0 - 1e-5


@dataclass(frozen=True)
class Run:
    """The problems of a closed-loop run of K control ticks.

    Attributes:
        states: Initial states of pan and tilt, shape (K, 2, 5).
        references: Reference angles, shape (K, 2, N).
        situations: What the controller was told at each tick.
        binding: Whether a limit binds, shape (K,): the best motion without limits would leave one.
        by_limit: In how many ticks each limit is reached somewhere on the horizon.
        softened: In how many ticks ours left a limit; others, with hard limits, would have no solution.
        solvers: How many of the 2 K programs each solver answered.
    """

    states: FloatArray
    references: FloatArray
    situations: list[Situation]
    binding: NDArray[np.bool_]
    by_limit: dict[str, int]
    softened: int
    solvers: dict[str, int]


def simulate(neck: NeckSpec, steps: int, ticks: int, seed: int = 0) -> Run:
    """Run our solver in closed loop, always with `STEPS` steps: joint and command move as the model says.

    Args:
        neck: The neck, with one dead time, a whole number of control periods.
        steps: For how many steps references are given.
        ticks: Control ticks.
        seed: For the noise of what is seen.

    Returns:
        What it had to solve.
    """
    limits, ocps = neck.command_limits, Gazempc(neck, STEPS, SMOOTHING_TIME_S).ocps
    models = [tick_matrices(neck, i) for i in range(2)]
    late = round(float(neck.dead_time_s[0]) / neck.control_period_s)
    on_the_way = late * neck.servo_ticks_per_plan + 1
    low, high = float(limits.position_min_rad[0]), float(limits.position_max_rad[0])
    # The controller's own steps grow; it asks for the forecast at their ends.
    ends = np.cumsum(growing_steps(STEPS * neck.control_period_s, neck.control_period_s)) - 1
    z = np.zeros((2, 5))
    states, references, situations, answers = [], [], [], list[list[Solution]]()
    joints, sent = list[FloatArray](), list[FloatArray]()
    for k, forecast in enumerate(forecasts(neck, max(steps, STEPS), ticks, seed)):
        angles = look_at(neck.geometry, forecast.means_base_m).angles_rad
        if k == 0:
            z[:, 0] = z[:, 2] = limits.clip_position(angles[0])
            joints, sent = [z[:, :2]] * late, [z[:, 2]] * on_the_way
        states.append(z)
        reference = unwrap_pan(angles, float(z[0, 2]), low, high).T
        references.append(reference[:, :steps])
        # z is one dead time ahead of the joint, whose state now is therefore that of some ticks ago.
        q, v = joints[k].T
        situations.append(
            Situation.of(
                settled_joints(neck, 0),
                start_s=k * neck.control_period_s,
                forecast=Forecast(
                    forecast.times_s[ends],
                    forecast.means_base_m[ends],
                    forecast.covariances_m2[ends],
                    forecast.issued_at_s,
                ),
                command=CommandState(z[:, 2], z[:, 3], z[:, 4]),
                joint_position_rad=q,
                joint_velocity_rad_s=v,
                joint_offset_rad=np.zeros(2),
                sent_rad=np.array(sent[-on_the_way:]),
                committed_rad=np.zeros((0, 2)),
            )
        )
        answers.append([ocp.solve(z[i], reference[i, :STEPS]) for i, ocp in enumerate(ocps)])
        joints.append(z[:, :2])
        z = z.copy()
        jerks = [answers[k][i].scaled_jerk[0] * ocps[i].model.jerk_scale for i in range(2)]
        for _ in range(neck.servo_ticks_per_plan):
            for i, (M, m) in enumerate(models):
                z[i] = M @ z[i] + m * jerks[i]
            sent.append(z[:, 2].copy())
    used = [solution.solver for answer in answers for solution in answer]
    return Run(
        states=np.array(states),
        references=np.array(references),
        situations=situations,
        binding=np.array([any(solution.solver != "gain" for solution in answer) for answer in answers]),
        by_limit=_by_limit(limits, answers),
        softened=sum(any(solution.softened for solution in answer) for answer in answers),
        solvers={name: used.count(name) for name in sorted(set(used))},
    )


def _by_limit(limits: CommandLimits, answers: list[list[Solution]]) -> dict[str, int]:
    command = np.array([[solution.command for solution in answer] for answer in answers])
    jerk = np.array([[solution.scaled_jerk for solution in answer] for answer in answers])
    position = command[:, :, 0]
    high, low = limits.position_max_rad[:, None], limits.position_min_rad[:, None]
    shares = {
        "position": np.abs(2.0 * position - high - low) / (high - low),
        "velocity": np.abs(command[:, :, 1]) / limits.velocity_max_rad_s[:, None],
        "acceleration": np.abs(command[:, :, 2]) / limits.acceleration_max_rad_s2[:, None],
        "jerk": np.abs(jerk),
    }
    return {name: int(np.sum(np.any(share > _REACHED, axis=(1, 2)))) for name, share in shares.items()}
