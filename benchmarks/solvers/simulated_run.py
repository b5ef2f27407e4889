"""A closed-loop run of the MPC: its programs, tick by tick, and the computing times of solvers on them."""

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
# Directions of standing targets, pan and tilt, after a person who leaves at pan 63 deg; the third is out of range.
_TARGETS_DEG = ((-20, -15), (50, 30), (100, 60), (40, 10), (-35, -30), (20, -20))
_TARGET_DISTANCE_M = 1.5
# Maximum speed of a standing person's head.
_STANDING_M_S = 0.1


def heads_m(times_s: FloatArray) -> FloatArray:
    """Head positions of the walking person, shape (H, 3); at a pan angle of 63 deg at time 0."""
    # Bob at twice the stride frequency, sway at the stride frequency.
    stride = 2.0 * np.pi * 0.9 * times_s
    return np.stack([1.5 + 0.02 * np.sin(stride), 3.0 + 1.2 * times_s, 0.35 + 0.02 * np.sin(2.0 * stride)], axis=1)


def target_m(pan_deg: float, tilt_deg: float) -> FloatArray:
    """Head position in a direction, shape (3,)."""
    pan, tilt = np.deg2rad((pan_deg, tilt_deg))
    return _TARGET_DISTANCE_M * np.array([np.cos(pan) * np.cos(tilt), np.sin(pan) * np.cos(tilt), np.sin(tilt)])


def forecasts(neck: NeckSpec, steps: int, ticks: int, seed: int) -> Iterator[Forecast]:
    """Forecasts at the control ticks.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        ticks: Control ticks.
        seed: Seed of the measurement noise.

    Yields:
        In the first four tenths, the true path of a walking person; in the next two tenths, constant-velocity forecasts
        of the person from noisy observations; then a sequence of standing people, each forecast at the mean of noisy
        observations.
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
        binding: Whether a limit is active, shape (K,): the unconstrained optimum violates one.
        softened: Number of ticks in which this project's soft limits are violated: infeasible with hard limits.
        solvers: Number of the 2 K programs by solver.
    """

    states: FloatArray
    references: FloatArray
    binding: NDArray[np.bool_]
    softened: int
    solvers: dict[str, int]


def simulate(neck: NeckSpec, steps: int, ticks: int, seed: int = 0) -> Run:
    """Run this project's solver in closed loop with `STEPS` steps, without model mismatch.

    Args:
        neck: The neck, with one dead time, a whole number of control periods.
        steps: Number of steps of the references.
        ticks: Control ticks.
        seed: Seed of the measurement noise.

    Returns:
        The programs of the run.
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


# Tolerance of agreement with the accurate command.
AGREE_RAD = 1e-4
# Number of untimed initial calls.
WARM_UP = 5
Figures = dict[str, Any]


def solve_all(peer: Peer, run: Run) -> tuple[FloatArray, FloatArray]:
    """Solve all ticks in sequence with one solver.

    Args:
        peer: The solver.
        run: Programs to solve.

    Returns:
        CPU time of each call, shape (K,), milliseconds; command of pan and tilt at the end of the first control
        period, shape (K, 2), radians, NaN after a failure.
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
    """Measure one solver: computing times, and errors of its commands.

    Args:
        peer: The solver.
        run: Programs to solve.
        accurate_rad: Accurate commands at the end of the first control period, shape (K, 2).

    Returns:
        Name, CPU times of a call for both joints in milliseconds, maximum error of the command in radians, number of
        ticks with an error above `AGREE_RAD`, and number of failures.
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
    """Compute the reference commands.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        run: Programs to solve.

    Returns:
        Accurate commands at the end of the first control period, shape (K, 2), radians.
    """
    first = solve_all(Accurate(neck, steps, SMOOTHING_TIME_S), run)[1]
    if np.isnan(first).any():
        raise RuntimeError(f"no accurate solution in {np.isnan(first).any(axis=1).sum()} ticks at N = {steps}")
    return first


def grow(neck: NeckSpec, steps: int, ticks: int) -> Figures:
    """Measure this project's solver at one horizon length, on the states of the same run.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        ticks: Control ticks of the run.

    Returns:
        Result of `measure`, named by the length, and the median time with active limits; None without such ticks.
    """
    run, ours = simulate(neck, steps, ticks), Gazempc(neck, steps, SMOOTHING_TIME_S)
    found = measure(ours, run, accurate_commands(neck, steps, run))
    used = np.array([ours.used(*problem) for problem in zip(run.states, run.references, strict=True)])
    binding_ms = solve_all(ours, run)[0][WARM_UP:][(used[WARM_UP:] != "gain").any(axis=1)]
    median = float(np.median(binding_ms)) if binding_ms.size else None
    return found | {"name": f"N = {steps}", "median_binding_ms": median}


def table(rows: Sequence[Figures]) -> str:
    """Format the results as a table.

    Args:
        rows: Results of `measure` or of `grow`; the first is the reference of the ratios.

    Returns:
        Lines of the table.
    """
    lines = [f"{'':<14}{'ratio':>8}" + "".join(f"{name:>21}" for name in list(rows[0])[1:])]
    for row in rows:
        cells = [f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in list(row.values())[1:]]
        ratio = row["median_ms"] / rows[0]["median_ms"]
        lines.append(f"{row['name']:<14}{ratio:>8.1f}" + "".join(f"{cell:>21}" for cell in cells))
    return "\n".join(lines)
