"""Speed of replays: `python -m benchmarks.throughput`.

Simulated seconds per CPU second of a replay (construction of its parts included), for each gaze and forecast, on a few
synthetic walks. Each pair runs in a separate process with one numerical thread, like a worker of an experiment. The
first replay also constructs shared parts, and is reported separately.
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor

import tyro

from gazempc.sim.replay import replay_scene
from gazempc.sim.scene import make_scene

# Each of the six routes once, by different people.
RECORDINGS = ("subject01_R1", "subject03_R4", "subject05_R2", "subject07_R6", "subject10_R5", "subject12_R3")
# One thread: more are slower for small matrices, and add CPU time.
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def measure(controller: str, predictor: str, repetitions: int) -> tuple[list[float], float]:
    """Replay all recordings in this process.

    Args:
        controller: Name of the controller.
        predictor: Name of the predictor.
        repetitions: Replays of each recording; the fastest, least disturbed by other programs, is used.

    Returns:
        Simulated seconds per CPU second of each recording; CPU time of the first replay, seconds.
    """
    scenes = [make_scene(name) for name in RECORDINGS]

    def replay(k: int) -> tuple[float, float]:
        started_s = time.process_time()
        log = replay_scene(scenes[k], controller, predictor).log
        return time.process_time() - started_s, float(log.time_s[-1])

    first_s, _ = replay(0)
    fastest = [min(replay(k) for _ in range(repetitions)) for k in range(len(scenes))]
    return [simulated_s / cpu_s for cpu_s, simulated_s in fastest], first_s


def main(repetitions: int = 3) -> None:
    """Measure and print.

    Args:
        repetitions: Replays of each recording.
    """
    os.environ.update(_ONE_THREAD)
    print(f"{'gaze':<10} {'forecast':<18} simulated s per CPU s (slowest walk), CPU s of the first replay")
    for controller, predictor in itertools.product(("reactive", "lookahead", "mpc"), ("constant_velocity", "walker")):
        # A separate process, like a worker of an experiment.
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            rates, first_s = pool.submit(measure, controller, predictor, repetitions).result()
        mean = sum(rates) / len(rates)
        print(f"{controller:<10} {predictor:<18} {mean:5.1f} ({min(rates):.1f}), {first_s:.2f} s", flush=True)


if __name__ == "__main__":
    tyro.cli(main, prog="python -m benchmarks.throughput", description=__doc__)
