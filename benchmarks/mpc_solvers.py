"""The gaze MPC's solver beside other ways to solve the same problem: `python -m benchmarks.mpc_solvers`.

One closed-loop run of the MPC is simulated. A person walks past, first with their way known ahead, then forecast from
noisy sightings. After that the target changes every second, 50 to 90 degrees away and once beyond the limits. So limits
of position, velocity, acceleration and jerk bind. Every solver gets the states and references of this run's control
ticks, one after the other; its commands are compared with an accurate solution. Times are process CPU time of whole
calls as seen from Python, for both joints, on one thread. They depend on the machine: read the ratios.
"""

from __future__ import annotations

import os

# One thread for linear algebra: CPU time counts the waiting of others. Must be set before numpy is imported.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import json
import platform
import sys
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from pydantic import BaseModel, ConfigDict, Field

from benchmarks.solvers.figures import Figures, table
from benchmarks.solvers.measure import accurate_commands, grow, measure, time_steps
from benchmarks.solvers.nlp_peers import DoMpc
from benchmarks.solvers.ours import DaqpAlways, Gazempc
from benchmarks.solvers.peer import Peer
from benchmarks.solvers.qp_peers import CasadiQrqp, Osqp, PiqpPackage
from benchmarks.solvers.simulated_run import SMOOTHING_TIME_S, STEPS, simulate
from benchmarks.step_time import bare_kalman_step
from gazempc.command import run_interruptible
from gazempc.errors import SettingsError, suggest
from gazempc.neck.spec import load_neck

PEERS: Sequence[type[Peer]] = (Gazempc, DaqpAlways, CasadiQrqp, PiqpPackage, Osqp, DoMpc)


class MpcSolversSettings(BaseModel):
    """Settings of `python -m benchmarks.mpc_solvers`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    ticks: int = Field(
        default=500, ge=20, description="Control ticks of the run; six tenths of them of the person walking"
    )
    peers: tuple[str, ...] = Field(
        default=tuple(peer.name for peer in PEERS), min_length=1, description="Solvers to measure"
    )
    growth: tuple[Annotated[int, Field(ge=2)], ...] = Field(
        default=(20, 40, 80, 160), description="Lengths of the horizon to measure ours with, control periods"
    )
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = Field(
        default=None, description="Where to save the figures"
    )


def chosen_peers(names: Sequence[str]) -> tuple[list[type[Peer]], list[str]]:
    """Find the solvers that were asked for.

    Args:
        names: Their names; ours is always among them.

    Returns:
        Those that are installed, and for each other one what to do about it.

    Raises:
        SettingsError: If there is no such solver.
    """
    known = {peer.name: peer for peer in PEERS}
    for name in names:
        if name not in known:
            raise SettingsError(f"--peers: there is no {name!r}; {suggest(name, known)}")
    asked = [peer for peer in PEERS if peer.name in names or peer is Gazempc]
    missing = [peer for peer in asked if not peer.is_installed()]
    how = [f"{peer.name}: skipped, not installed: pip install {peer.package} (extra 'bench')" for peer in missing]
    return [peer for peer in asked if peer not in missing], how


def benchmark(settings: MpcSolversSettings) -> int:
    """Measure, print and save.

    Args:
        settings: What to measure.

    Returns:
        Exit status, see `main`.

    Raises:
        SettingsError: On bad input, before anything runs.
    """
    peers, missing = chosen_peers(settings.peers)
    for line in missing:
        print(line)
    neck = load_neck("reference")
    run = simulate(neck, STEPS, settings.ticks)
    bare_ms = float(np.median(bare_kalman_step()))
    accurate_rad = accurate_commands(neck, STEPS, run)
    # Before other packages fill the memory: no robot has them loaded.
    step_median_ms, step_p99_ms = time_steps(neck, run)
    found = [measure(peer(neck, STEPS, SMOOTHING_TIME_S), run, accurate_rad) for peer in peers]
    found[0].step_median_ms, found[0].step_p99_ms = step_median_ms, step_p99_ms
    figures = Figures(
        peers=found,
        growth=[grow(neck, steps, settings.ticks) for steps in settings.growth],
        ticks=settings.ticks,
        ticks_with_limits=int(run.binding.sum()),
        ticks_by_limit=run.by_limit,
        ticks_softened=run.softened,
        solvers=run.solvers,
        bare_kalman_ms=bare_ms,
        versions={name: version(name) for name in ("numpy", "daqp", *sorted({peer.package for peer in peers}))},
        machine={
            "python": platform.python_version(),
            "platform": platform.platform(),
            "processors": os.cpu_count() or 1,
        },
    )
    print(table(figures))
    if settings.json_file is not None:
        settings.json_file.write_text(json.dumps(asdict(figures), indent=2) + "\n", encoding="utf-8")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 2 on bad input, 130 if interrupted.
    """
    settings = tyro.cli(
        MpcSolversSettings, args=arguments, prog="python -m benchmarks.mpc_solvers", description=__doc__
    )
    return run_interruptible("mpc_solvers", lambda: benchmark(settings))


if __name__ == "__main__":
    sys.exit(main())
