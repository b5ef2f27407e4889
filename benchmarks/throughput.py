"""How fast replays are: `python -m benchmarks.throughput --json out/throughput.json`.

Simulated seconds per CPU second of a replay (construction of its parts included), for each gaze and forecast, on a few
synthetic walks. Each pair has a process of its own, with one numerical thread, as a worker of an experiment has. Its
first replay also builds what later ones share, and is reported apart. With `--comparison`, also the wall time of
`experiments.compare` on all 84 synthetic recordings, with one worker and with two.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import platform
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import tyro

from experiments.compare import compare
from gazempc.results.run_summary import versions
from gazempc.sim.replay import replay_scene
from gazempc.sim.scene import SceneSettings, make_scene

CONTROLLERS = ("reactive", "lookahead", "mpc")
PREDICTORS = ("constant_velocity", "walker")
# Each of the six routes once, by different people.
RECORDINGS = ("subject01_R1", "subject03_R4", "subject05_R2", "subject07_R6", "subject10_R5", "subject12_R3")
# More threads cost more than these small matrices gain, and each counts as CPU time.
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def measure(controller: str, predictor: str, repetitions: int) -> dict[str, Any]:
    """Replay all recordings in this process.

    Args:
        controller: Name of the controller.
        predictor: Name of the predictor.
        repetitions: Replays of each recording; the fastest counts, as other programs delay the others.

    Returns:
        Simulated seconds per CPU second, mean over the recordings and of the slowest; CPU time of the first replay.
    """
    scenes = [make_scene(name, SceneSettings()) for name in RECORDINGS]

    def replay(k: int) -> tuple[float, float]:
        started_s = time.process_time()
        log = replay_scene(scenes[k], controller, predictor).log
        return time.process_time() - started_s, float(log.time_s[-1])

    first_s, _ = replay(0)
    rates = []
    for k in range(len(scenes)):
        cpu_s, simulated_s = min(replay(k) for _ in range(repetitions))
        rates.append(simulated_s / cpu_s)
    return {
        "controller": controller,
        "predictor": predictor,
        "simulated_s_per_cpu_s": sum(rates) / len(rates),
        "slowest": min(rates),
        "first_replay_cpu_s": first_s,
    }


def comparison(workers: int) -> dict[str, float]:
    """Compare the gazes on all synthetic recordings, afresh.

    Args:
        workers: Worker processes.

    Returns:
        Workers, runs, wall time with the start of the workers, simulated seconds; times in seconds.
    """
    with tempfile.TemporaryDirectory() as folder:
        started_s = time.perf_counter()
        rows = compare(recordings=["synthetic"], controllers=CONTROLLERS, jobs=workers, out=Path(folder), figures=False)
        wall_s = time.perf_counter() - started_s
    simulated_s = sum(row["simulated_s"] for row in rows)
    return {"workers": workers, "runs": len(rows), "wall_s": wall_s, "simulated_s": simulated_s}


def main(
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
    repetitions: int = 3,
    comparison_too: Annotated[bool, tyro.conf.arg(name="comparison")] = False,
) -> None:
    """Measure and print.

    Args:
        json_file: Where to save the numbers.
        repetitions: Replays of each recording.
        comparison_too: Also time the whole comparison.
    """
    os.environ.update(_ONE_THREAD)
    found: dict[str, Any] = {
        "rows": [],
        "recordings": RECORDINGS,
        "versions": versions(),
        "machine": platform.platform(),
    }
    print(f"{'gaze':<10} {'forecast':<18} simulated s per CPU s (slowest walk), CPU s of the first replay")
    for controller in CONTROLLERS:
        for predictor in PREDICTORS:
            # A process of its own, as of a worker of an experiment.
            with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
                row = pool.submit(measure, controller, predictor, repetitions).result()
            found["rows"].append(row)
            print(
                f"{controller:<10} {predictor:<18} {row['simulated_s_per_cpu_s']:5.1f} ({row['slowest']:.1f}), "
                f"{row['first_replay_cpu_s']:.2f} s",
                flush=True,
            )
    if comparison_too:
        found["comparison"] = [comparison(workers) for workers in (1, 2)]
        for run in found["comparison"]:
            rate = run["simulated_s"] / run["wall_s"]
            print(f"{run['runs']} replays, {run['workers']} worker(s): {run['wall_s']:.1f} s, {rate:.1f} simulated s/s")
    if json_file is not None:
        json_file.parent.mkdir(parents=True, exist_ok=True)
        json_file.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.throughput", description=__doc__)
