"""How fast comparisons run: `python -m benchmarks.throughput`.

Simulated seconds per wall second of `experiments.compare`'s runs on synthetic walks: with one worker and with two, for
more and more recordings, with the workers' peak memory (which must not grow with the number of runs), and for longer
and longer horizons of the MPC in one process. Wall times: read the ratios, on a machine that does nothing else.
"""

from __future__ import annotations

import json
import multiprocessing
import resource
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import tyro

from experiments.engine.jobs import Job, execute
from experiments.engine.pool import run_jobs
from gazempc.neck.spec import load_neck
from gazempc.recordings.load import load
from gazempc.recordings.placement import place
from gazempc.recordings.synthetic.walks import synthetic_names
from gazempc.settings import ControllerName, RunSettings
from gazempc.sim.replay import make_controller, replay
from gazempc.sim.sensor import load_sensor

CONTROLLERS: tuple[ControllerName, ...] = ("reactive", "lookahead", "mpc")


def make_jobs(recordings: int) -> list[Job]:
    """Runs of all controllers on the first recordings of the synthetic set."""
    return [
        Job(name, controller, "constant_velocity", "reference", "reference", "recorded", 2.5, 1.2, 0)
        for name in synthetic_names()[:recordings]
        for controller in CONTROLLERS
    ]


def throughput(recordings: int, workers: int) -> tuple[float, float]:
    """Do the runs afresh.

    Args:
        recordings: How many recordings.
        workers: How many processes.

    Returns:
        Wall time in seconds, start of the workers included, and simulated seconds.
    """
    with tempfile.TemporaryDirectory() as folder:
        started_s = time.perf_counter()
        rows = run_jobs(make_jobs(recordings), Path(folder), workers, execute)
        return time.perf_counter() - started_s, sum(row["simulated_s"] for row in rows)


def peak_memory_mib(runs: int) -> float:
    """Peak memory of one worker process after a number of runs, MiB."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        for job in (make_jobs(14) * 10)[:runs]:
            pool.submit(execute, job).result()
        return pool.submit(_peak_rss_mib).result()


def _peak_rss_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def horizon_s_per_s(horizon_s: float) -> float:
    """Simulated seconds of the MPC per second of CPU time, on one walk."""
    settings = RunSettings.model_validate({"mpc": {"horizon_s": horizon_s}})
    neck, sensor = load_neck("reference"), load_sensor("reference")
    placed = place(load("subject03_R4"), "recorded", 2.5, 1.2)
    controller = make_controller("mpc", neck, settings)
    started_s = time.process_time()
    log, _ = replay(placed, neck, sensor, "mpc", settings, controller)
    return float(log.time_s[-1]) / (time.process_time() - started_s)


def main(
    recordings: tuple[int, ...] = (14, 42, 84),
    horizons_s: tuple[float, ...] = (0.4, 0.8, 1.6),
    json_file: Path | None = None,
) -> None:
    """Measure and print.

    Args:
        recordings: Numbers of recordings to run.
        horizons_s: Horizons of the MPC.
        json_file: Where to save the figures.
    """
    found: dict[str, list[dict[str, float]]] = {"recordings": [], "memory": [], "horizon": []}
    print(f"{len(CONTROLLERS)} controllers on each recording")
    for n in recordings:
        one_s, simulated_s = throughput(n, workers=1)
        two_s, _ = throughput(n, workers=2)
        found["recordings"].append({"n": n, "one_worker_s": one_s, "two_workers_s": two_s, "simulated_s": simulated_s})
        print(
            f"{n:>3} recordings: {simulated_s / one_s:5.1f} simulated s/s with one worker ({one_s:.0f} s), "
            f"{simulated_s / two_s:5.1f} with two ({two_s:.0f} s), {one_s / two_s:.2f} x"
        )
    for runs in (10, 60):
        found["memory"].append({"runs": runs, "peak_mib": peak_memory_mib(runs)})
        print(f"{runs:>3} runs: peak memory of a worker {found['memory'][-1]['peak_mib']:.0f} MiB")
    for horizon_s in horizons_s:
        found["horizon"].append({"horizon_s": horizon_s, "simulated_s_per_cpu_s": horizon_s_per_s(horizon_s)})
        print(f"MPC horizon {horizon_s:g} s: {found['horizon'][-1]['simulated_s_per_cpu_s']:.1f} simulated s per CPU s")
    if json_file is not None:
        json_file.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.throughput", description=__doc__)
