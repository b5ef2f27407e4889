"""Times of solvers on a simulated run, and whether their commands are the accurate ones."""

from __future__ import annotations

import contextlib
import gc
import time

import numpy as np
from tqdm import tqdm

from benchmarks.solvers.figures import AGREE_RAD, WARM_UP, GrowthFigures, PeerFigures
from benchmarks.solvers.ours import Gazempc
from benchmarks.solvers.peer import Peer, PeerFailedError
from benchmarks.solvers.qp_peers import Accurate
from benchmarks.solvers.simulated_run import SMOOTHING_TIME_S, Run, simulate
from benchmarks.step_time import cpu_ms
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray


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


def measure(peer: Peer, run: Run, accurate_rad: FloatArray) -> PeerFigures:
    """Time one solver and compare its commands.

    Args:
        peer: The solver.
        run: What to solve.
        accurate_rad: Accurate commands at the end of the first control period, shape (K, 2).

    Returns:
        The figures.
    """
    times_ms, first = solve_all(peer, run)
    difference = np.abs(first - accurate_rad).max(axis=1)
    failed = np.isnan(difference)
    timed_ms = times_ms[WARM_UP:]
    return PeerFigures(
        name=peer.name,
        median_ms=float(np.median(timed_ms)),
        p95_ms=float(np.percentile(timed_ms, 95)),
        p99_ms=float(np.percentile(timed_ms, 99)),
        max_ms=float(timed_ms.max()),
        agrees=bool(np.all(difference <= AGREE_RAD)),
        worst_difference_rad=None if failed.all() else float(np.nanmax(difference)),
        ticks_over=int(np.sum(difference > AGREE_RAD)),
        failures=int(failed.sum()),
        calls=len(timed_ms),
    )


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


def time_steps(neck: NeckSpec, run: Run) -> tuple[float, float]:
    """Time whole control steps of the MPC, forecast in, plan out.

    Args:
        neck: The neck.
        run: With the situations.

    Returns:
        Median and 99th percentile, CPU milliseconds.
    """
    mpc = Mpc(neck)
    gc.collect()
    times_ms = [cpu_ms(lambda s=situation: mpc.plan(s)) for situation in run.situations][WARM_UP:]  # type: ignore[misc]
    return float(np.median(times_ms)), float(np.percentile(times_ms, 99))


def grow(neck: NeckSpec, steps: int, ticks: int) -> GrowthFigures:
    """Time ours with one length of the horizon, from the states of the same run, and check its commands.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        ticks: Control ticks of the run.

    Returns:
        The figures.
    """
    run, ours = simulate(neck, steps, ticks), Gazempc(neck, steps, SMOOTHING_TIME_S)
    accurate_rad = accurate_commands(neck, steps, run)
    times_ms, first = solve_all(ours, run)
    used = np.array([ours.used(*problem) for problem in zip(run.states, run.references, strict=True)])
    binding_ms = times_ms[WARM_UP:][(used[WARM_UP:] != "gain").any(axis=1)]
    difference = np.abs(first - accurate_rad).max(axis=1)
    failed = np.isnan(difference)
    return GrowthFigures(
        horizon_steps=steps,
        median_ms=float(np.median(times_ms[WARM_UP:])),
        p99_ms=float(np.percentile(times_ms[WARM_UP:], 99)),
        median_binding_ms=float(np.median(binding_ms)) if len(binding_ms) else None,
        worst_difference_rad=None if failed.all() else float(np.nanmax(difference)),
        solvers={str(name): int(np.sum(used == name)) for name in np.unique(used)},
        calls=len(times_ms) - WARM_UP,
        failures=int(failed.sum()),
    )
