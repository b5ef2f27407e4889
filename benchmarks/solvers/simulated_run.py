"""A closed-loop run of the MPC: what its solver has to solve, tick by tick, and the times of solvers on it."""

from __future__ import annotations

import contextlib
import gc
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.solvers.peers import Accurate, Gazempc, Peer, PeerFailedError
from benchmarks.solvers.problem import tick_matrices
from gazempc.controllers.mpc.ocp import Solution
from gazempc.neck.kinematics import look_at_rad, unwrap_pan
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray
from predictors import ConstantVelocity, Forecast, HeadObservation

_NOISE_M = 0.01
_HOLD_TICKS = 50
# Where the targets are, pan and tilt; the person before them leaves at pan 63 deg, and the third is beyond the limits.
_TARGETS_DEG = ((-20, -15), (50, 30), (100, 60), (40, 10), (-35, -30), (20, -20))
_TARGET_DISTANCE_M = 1.5
# Speed of a standing person's head, at most.
_STANDING_M_S = 0.1


def heads_m(times_s: FloatArray) -> FloatArray:
    """Head of the person who walks past, shape (H, 3); at time 0 it is at a pan angle of 63 deg."""
    # The head goes up and down twice, and sideways once, a stride.
    stride = 2.0 * np.pi * 0.9 * times_s
    return np.stack([1.5 + 0.02 * np.sin(stride), 3.0 + 1.2 * times_s, 0.35 + 0.02 * np.sin(2.0 * stride)], axis=1)


def target_m(pan_deg: float, tilt_deg: float) -> FloatArray:
    """A head in a direction, shape (3,)."""
    pan, tilt = np.deg2rad((pan_deg, tilt_deg))
    return _TARGET_DISTANCE_M * np.array([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), np.sin(tilt)])


def forecasts(neck: NeckSpec, steps: int, ticks: int, seed: int) -> Iterator[Forecast]:
    """What is forecast at each control tick.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        ticks: Control ticks.
        seed: For the noise of what is seen.

    Yields:
        In the first four tenths, the way that a person really walks past. In the next two tenths, a constant-velocity
        forecast of them from noisy sightings. Then people who stand in one place after the other, each forecast at the
        mean of their noisy sightings.
    """
    rng = np.random.default_rng(seed)
    period_s, known, walking = neck.control_period_s, 4 * ticks // 10, 6 * ticks // 10
    ahead_s: FloatArray = neck.dead_time_s[0] + period_s * np.arange(1, steps + 1)
    predictor = ConstantVelocity(position_noise_m=_NOISE_M)
    since = -walking * period_s
    mean_noise_m = np.zeros(3)
    variances_m2 = _NOISE_M**2 + (_STANDING_M_S * ahead_s) ** 2
    for k in range(ticks):
        now_s, noise_m = k * period_s, rng.normal(scale=_NOISE_M, size=3)
        if k < walking:
            head_m = heads_m(np.array([since + now_s]))[0]
            predictor.update(HeadObservation(now_s, head_m + noise_m))
        if known <= k < walking:
            yield predictor.forecast(now_s + ahead_s)
            continue
        if k < known:
            means_m = heads_m(since + now_s + ahead_s)
        else:
            since_change = (k - walking) % _HOLD_TICKS
            target = _TARGETS_DEG[(k - walking) // _HOLD_TICKS % len(_TARGETS_DEG)]
            mean_noise_m = mean_noise_m + (noise_m - mean_noise_m) / (since_change + 1)
            means_m = np.tile(target_m(*target) + mean_noise_m, (len(ahead_s), 1))
        yield Forecast(now_s + ahead_s, means_m, variances_m2[:, None, None] * np.eye(3), now_s)


STEPS = 40
SMOOTHING_TIME_S = 0.075


@dataclass(frozen=True)
class Run:
    """The problems of a closed-loop run of K control ticks.

    Attributes:
        states: Initial states of pan and tilt, shape (K, 2, 5).
        references: Reference angles, shape (K, 2, N).
        binding: Whether a limit binds, shape (K,): the best motion without limits would leave one.
        softened: In how many ticks ours left a limit; others, with hard limits, would have no solution.
        solvers: How many of the 2 K programs each solver answered.
    """

    states: FloatArray
    references: FloatArray
    binding: NDArray[np.bool_]
    softened: int
    solvers: dict[str, int]


def simulate(neck: NeckSpec, steps: int, ticks: int, seed: int = 0) -> Run:
    """Run our solver in closed loop, always with `STEPS` steps: joint and command move by the model.

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
    low, high = float(limits.position_min_rad[0]), float(limits.position_max_rad[0])
    z = np.zeros((2, 5))
    states, references, answers = [], [], list[list[Solution]]()
    for k, forecast in enumerate(forecasts(neck, max(steps, STEPS), ticks, seed)):
        angles = look_at_rad(neck.geometry, forecast.means_base_m)
        if k == 0:
            z[:, 0] = z[:, 2] = limits.clip_position(angles[0])
        states.append(z)
        reference = unwrap_pan(angles, float(z[0, 2]), low, high).T
        references.append(reference[:, :steps])
        answers.append([ocp.solve(z[i], reference[i, :STEPS]) for i, ocp in enumerate(ocps)])
        z = z.copy()
        jerks = [answers[k][i].scaled_jerk[0] * ocps[i].model.jerk_scale for i in range(2)]
        for _ in range(neck.servo_ticks_per_plan):
            for i, (M, m) in enumerate(models):
                z[i] = M @ z[i] + m * jerks[i]
    used = [solution.solver for answer in answers for solution in answer]
    return Run(
        states=np.array(states),
        references=np.array(references),
        binding=np.array([any(solution.solver != "gain" for solution in answer) for answer in answers]),
        softened=sum(any(solution.softened for solution in answer) for answer in answers),
        solvers={name: used.count(name) for name in sorted(set(used))},
    )


# A command this near to the accurate one is the same.
AGREE_RAD = 1e-4
# Calls that are not timed: solvers set themselves up in their first ones.
WARM_UP = 5
Figures = dict[str, Any]


def solve_all(peer: Peer, run: Run) -> tuple[FloatArray, FloatArray]:
    """Let one solver solve all ticks, one after the other.

    Args:
        peer: The solver.
        run: What to solve.

    Returns:
        CPU time of each call, shape (K,), milliseconds; command of pan and tilt at the end of the first control
        period, shape (K, 2), radians, NaN where it found none.
    """
    times_ms, first = np.zeros(len(run.states)), np.full((len(run.states), 2), np.nan)
    gc.collect()
    progress = tqdm(zip(run.states, run.references, strict=True), total=len(first), desc=peer.name, leave=False)
    for k, (states, references) in enumerate(progress):
        command = np.full((2, 1), np.nan)
        started_ns = time.process_time_ns()
        with contextlib.suppress(PeerFailedError):
            command = peer.solve(states, references)
        times_ms[k] = 1e-6 * (time.process_time_ns() - started_ns)
        first[k] = command[:, 0]
    return times_ms, first


def measure(peer: Peer, run: Run, accurate_rad: FloatArray) -> Figures:
    """Time one solver and compare its commands.

    Args:
        peer: The solver.
        run: What to solve.
        accurate_rad: Accurate commands at the end of the first control period, shape (K, 2).

    Returns:
        Its name, CPU times of a call for both joints in milliseconds, the largest difference in radians, ticks with a
        larger one than `AGREE_RAD`, and ticks without a command.
    """
    times_ms, first = solve_all(peer, run)
    difference = np.abs(first - accurate_rad).max(axis=1)
    failed = np.isnan(difference)
    median, p95, p99, most = np.percentile(times_ms[WARM_UP:], [50, 95, 99, 100]).tolist()
    return {
        "name": peer.name,
        "median_ms": median,
        "p95_ms": p95,
        "p99_ms": p99,
        "max_ms": most,
        "worst_difference_rad": None if failed.all() else float(np.nanmax(difference)),
        "ticks_over": int(np.sum(difference > AGREE_RAD)),
        "failures": int(failed.sum()),
        "agrees": bool(np.all(difference <= AGREE_RAD)),
    }


def accurate_commands(neck: NeckSpec, steps: int, run: Run) -> FloatArray:
    """Find what commands are compared with.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        run: What to solve.

    Returns:
        Accurate commands at the end of the first control period, shape (K, 2), radians.
    """
    first = solve_all(Accurate(neck, steps, SMOOTHING_TIME_S), run)[1]
    if np.isnan(first).any():
        raise RuntimeError(f"no accurate solution in {np.isnan(first).any(axis=1).sum()} ticks at N = {steps}")
    return first


def grow(neck: NeckSpec, steps: int, ticks: int) -> Figures:
    """Time ours with one length of the horizon, from the states of the same run, and check its commands.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        ticks: Control ticks of the run.

    Returns:
        The figures of `measure`, named by the length, and the median where limits bind; None if none does.
    """
    run, ours = simulate(neck, steps, ticks), Gazempc(neck, steps, SMOOTHING_TIME_S)
    found = measure(ours, run, accurate_commands(neck, steps, run))
    used = np.array([ours.used(*problem) for problem in zip(run.states, run.references, strict=True)])
    binding_ms = solve_all(ours, run)[0][WARM_UP:][(used[WARM_UP:] != "gain").any(axis=1)]
    median = float(np.median(binding_ms)) if binding_ms.size else None
    return found | {"name": f"N = {steps}", "median_binding_ms": median}


def table(rows: Sequence[Figures]) -> str:
    """Write figures for reading.

    Args:
        rows: Of `measure` or `grow`, all of one kind; the first one is what medians are compared with.

    Returns:
        Lines.
    """
    lines = [f"{'':<14}{'ratio':>8}" + "".join(f"{name:>21}" for name in list(rows[0])[1:])]
    for row in rows:
        cells = [f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in list(row.values())[1:]]
        ratio = row["median_ms"] / rows[0]["median_ms"]
        lines.append(f"{row['name']:<14}{ratio:>8.1f}" + "".join(f"{cell:>21}" for cell in cells))
    return "\n".join(lines)
