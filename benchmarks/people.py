"""How long one frame with many people takes: `python -m benchmarks.people`.

Twenty people walk about and are seen 30 times a second, without names, with error. Of one of them a forecast is asked
for after each frame, as the loop does. Every 1.5 s attention switches to another person, announced 0.5 s before.
"""

from __future__ import annotations

import time

import numpy as np
import tyro

from gazempc.people.people import People
from gazempc.people.person import CATCH_UP
from gazempc.types import FloatArray
from predictors import HeadObservation, Walker

_RATE_HZ = 30.0
# 50 times a second, the loop chooses a person and lets the next person's predictor read older frames.
_CATCH_UP_A_FRAME = round(CATCH_UP * 50.0 / _RATE_HZ)
_AHEAD_S = np.linspace(0.0, 1.2, 13)


def _walks(count: int, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Positions on circles of their own, shape (T, count, 3), metres."""
    middles_m = np.column_stack([rng.uniform(1.0, 9.0, count), rng.uniform(-4.0, 4.0, count)])
    radius_m, rate_rad_s = rng.uniform(0.5, 2.0, count), rng.uniform(-0.8, 0.8, count)
    angle = rng.uniform(-np.pi, np.pi, count) + rate_rad_s * times_s[:, None]
    around_m = radius_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    height_m = np.broadcast_to(rng.uniform(0.2, 0.6, count)[:, None], (*angle.shape, 1))
    return np.concatenate([middles_m + around_m, height_m], axis=-1)


def frame_times_ms(count: int, seconds: float, seed: int) -> tuple[FloatArray, int]:
    """Time each frame.

    Args:
        count: How many people.
        seconds: For how long.
        seed: Of walks and errors.

    Returns:
        Process CPU time of each frame after the first second, shape (K, 2), milliseconds: first the tracks
        alone, then with the forecast and the next person's predictor. And the number of people at the end.
    """
    rng = np.random.default_rng(seed)
    times_s: FloatArray = np.arange(0.0, seconds, 1.0 / _RATE_HZ)
    seen_m = _walks(count, times_s, rng) + 0.01 * rng.standard_normal((times_s.size, count, 3))
    facing = np.array([1.0, 0.0, 0.0, 0.0])
    people, took_ms = People(Walker), []
    for k, time_s in enumerate(times_s.tolist()):
        frame = [HeadObservation(time_s, head_m, facing, facing) for head_m in seen_m[k]]
        started_s = time.process_time()
        people.see(frame)
        tracked_s = time.process_time()
        present = people.present(time_s)
        if present:
            now, soon = (people.track(present[turn % len(present)].number) for turn in (k // 45, (k + 15) // 45))
            if now is not None and soon is not None:
                soon.catch_up(_CATCH_UP_A_FRAME)
                now.forecast(time_s + _AHEAD_S)
        took_ms.append((1e3 * (tracked_s - started_s), 1e3 * (time.process_time() - started_s)))
    return np.array(took_ms[round(_RATE_HZ) :]), len(present)


def main(people: int = 20, seconds: float = 20.0, seed: int = 0) -> None:
    """Print a table.

    Args:
        people: How many people.
        seconds: Simulated time.
        seed: Of walks and errors.
    """
    took_ms, there = frame_times_ms(people, seconds, seed)
    print(f"{people} people at {_RATE_HZ:.0f} frames/s, {len(took_ms)} frames; at the end {there} tracks")
    for what, each_ms in zip(("tracks", "with forecast"), took_ms.T, strict=True):
        p50, p99 = np.percentile(each_ms, [50, 99])
        print(f"{what}: p50 {p50:.2f} ms, p99 {p99:.2f} ms, longest {each_ms.max():.2f} ms a frame")


if __name__ == "__main__":
    tyro.cli(main)
