"""Times of solvers on a simulated run, and whether their commands are the accurate ones."""

from __future__ import annotations

import contextlib
import gc
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.solvers.peers import Accurate, Gazempc, Peer, PeerFailedError
from benchmarks.solvers.simulated_run import SMOOTHING_TIME_S, Run, simulate
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

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
    timed_ms = times_ms[WARM_UP:]
    median, p95, p99, most = np.percentile(timed_ms, [50, 95, 99, 100]).tolist()
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
