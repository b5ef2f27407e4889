"""Background load, and scheduling gaps of the machine."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np

from gazempc.live.process import real_time_priority

_PERIOD_S = 0.005
# Longest gap within an interval of `time.monotonic`, seconds; milliseconds.
GapMs = Callable[[float, float], float]
# Least gap to record; shorter ones are due to the sleep.
_NOTED_S = 0.006


@contextmanager
def busy(cores: int) -> Iterator[None]:
    """Keep processor cores busy.

    Args:
        cores: Number of processes.
    """
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(cores)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


@contextmanager
def control() -> Iterator[GapMs]:
    """Reference process that repeatedly sleeps for a servo period, at the priority of a live run's servo.

    Yields:
        Function that returns the longest time between two wake-ups in an interval of `time.monotonic`, milliseconds.
    """
    with NamedTemporaryFile("w+") as noted:
        process = subprocess.Popen([sys.executable, "-m", "benchmarks.faults.machine"], stdout=noted)

        def gap_ms(from_s: float, to_s: float) -> float:
            woke_s = np.array(Path(noted.name).read_text().split(), dtype=float).reshape(-1, 2)
            within = (woke_s[:, 1] > from_s) & (woke_s[:, 0] < to_s)
            return 1e3 * float(np.max(np.diff(woke_s[within]), initial=_PERIOD_S))

        yield gap_ms
        process.kill()
        process.wait()


def _sleep() -> None:
    woke_s = time.monotonic()
    while True:
        time.sleep(_PERIOD_S)
        now_s = time.monotonic()
        if now_s - woke_s > _NOTED_S:
            print(woke_s, now_s, flush=True)
        woke_s = now_s


if __name__ == "__main__":
    with real_time_priority():
        _sleep()
