"""Compare the gaze MPC's solver with other solvers of the same problem: `python -m benchmarks.mpc_solvers`.

One closed-loop run of the MPC is simulated. A person walks past, first with known future positions, then with forecasts
from noisy observations. Then the target changes every second, by 50 to 90 degrees and once beyond the limits, so that
limits of position, velocity, acceleration and jerk are active. Every solver solves the sequence of states and
references of this run's control ticks; its commands are compared with an accurate solution. Times are process CPU time
of complete calls from Python, for both joints, on one thread; only their ratios are independent of the machine.
"""

from __future__ import annotations

import os

# One thread for linear algebra: CPU time includes busy waiting of others. Must be set before NumPy is imported.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import json
from pathlib import Path
from typing import Annotated

import tyro

from benchmarks.solvers import simulated_run
from benchmarks.solvers.peers import CasadiQrqp, DaqpAlways, DoMpc, Gazempc, Osqp, PiqpPackage
from benchmarks.solvers.simulated_run import AGREE_RAD, SMOOTHING_TIME_S, STEPS, WARM_UP
from gazempc.neck.spec import load_neck
from gazempc.results.run_summary import versions

PEERS = (Gazempc, DaqpAlways, CasadiQrqp, PiqpPackage, Osqp, DoMpc)


def main(
    ticks: int = 500,
    growth: tuple[int, ...] = (20, 40, 80, 160),
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
) -> None:
    """Measure, print and save; needs the extra `bench`.

    Args:
        ticks: Control ticks of the run; 60 % with the walking person.
        growth: Horizon lengths for this project's solver, control periods.
        json_file: File for the figures.
    """
    neck = load_neck("reference")
    run = simulated_run.simulate(neck, STEPS, ticks)
    accurate_rad = simulated_run.accurate_commands(neck, STEPS, run)
    peers = [simulated_run.measure(peer(neck, STEPS, SMOOTHING_TIME_S), run, accurate_rad) for peer in PEERS]
    grown = [simulated_run.grow(neck, steps, ticks) for steps in growth]
    binding = int(run.binding.sum())
    print(simulated_run.table(peers))
    print(
        f"ticks_over: more than {AGREE_RAD:g} rad from the accurate command; the first {WARM_UP} calls are not timed."
    )
    print(f"A limit is active in {binding} of {ticks} ticks, violated in {run.softened}. Solvers: {run.solvers}.")
    print(simulated_run.table(grown))
    if json_file is not None:
        found = {"peers": peers, "growth": grown, "ticks": ticks, "ticks_with_limits": binding, "versions": versions()}
        found |= {"ticks_softened": run.softened, "solvers": run.solvers}
        json_file.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.mpc_solvers", description=__doc__)
