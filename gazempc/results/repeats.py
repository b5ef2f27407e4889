"""The same walk under several seeds of the noise: means, and how far the seeds are apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gazempc.results.compute import measure_compute
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.metrics import measure
from gazempc.results.run_summary import Row, make_rows


@dataclass(frozen=True)
class Repeats:
    """Figures of one controller on one recording, once for each seed.

    Attributes:
        seeds: Seeds of the noise; logs and figures are of the first one.
        rows: The figures under each.
    """

    seeds: tuple[int, ...]
    rows: tuple[Row, ...]

    @property
    def first(self) -> Row:
        """The figures under the first seed."""
        return self.rows[0]

    def values(self, name: str) -> list[float]:
        """A figure under each seed, by its name in `summary.json`."""
        return [float(figures[name]) for figures in self._figures]

    @cached_property
    def _figures(self) -> list[dict[str, Any]]:
        # Once for all names: there are some seventy, and a row is copied deeply each time.
        return [row.as_dict() for row in self.rows]

    def mean(self, name: str) -> float:
        """Mean over the seeds that have the figure; NaN if none has."""
        known = [value for value in self.values(name) if math.isfinite(value)]
        return float(np.mean(known)) if known else math.nan

    def most(self, name: str) -> float:
        """Largest over the seeds."""
        return max(self.values(name))

    def sd(self, name: str) -> float:
        """Standard deviation over the seeds that have the figure; NaN with fewer than two."""
        known = [value for value in self.values(name) if math.isfinite(value)]
        return float(np.std(known, ddof=1)) if len(known) > 1 else math.nan

    def as_dict(self) -> dict[str, Any]:
        """What stands in `summary.json`: mean, s.d. and the values under each seed, by figure."""
        names = [name for name in self._figures[0] if name not in {"controller", "predictor"}]
        return {
            "controller": self.first.controller,
            "predictor": self.first.predictor,
            "mean": {name: self.mean(name) for name in names},
            "sd": {name: self.sd(name) for name in names},
            "per_seed": {name: self.values(name) for name in names},
        }


def by_controller(seeds: tuple[int, ...], rounds: list[list[Row]]) -> list[Repeats]:
    """The figures of each controller.

    Args:
        seeds: The seeds.
        rounds: For each seed the figures of all controllers, always in the same order.

    Returns:
        One entry a controller.
    """
    return [Repeats(seeds, rows) for rows in zip(*rounds, strict=True)]


def measured_again(log: Log) -> Repeats:
    """Figures of a log; the computing times are not in it, so these are NaN.

    Args:
        log: The log.

    Returns:
        The figures of its one run.
    """
    nothing = np.empty(0)
    times = measure_compute(ComputeTimes(nothing, nothing, nothing), log.neck.control_period_s)
    return Repeats((log.run.seed,), tuple(make_rows([(log.run.controller, log.run.predictor, measure(log), times)])))
