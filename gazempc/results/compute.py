"""Summary of the computing times of a run."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gazempc.results.log import ComputeTimes
from gazempc.types import FloatArray


@dataclass(frozen=True)
class ComputeMetrics:
    """Computing times; they differ from run to run.

    Attributes:
        update_ms_p50: Median predictor update, milliseconds.
        update_ms_p99: 99th percentile.
        update_ms_max: Longest.
        step_ms_p50: Median controller step (forecast and plan), milliseconds.
        step_ms_p99: 99th percentile.
        step_ms_max: Longest.
        missed_deadlines: Steps that took longer than a control period.
    """

    update_ms_p50: float
    update_ms_p99: float
    update_ms_max: float
    step_ms_p50: float
    step_ms_p99: float
    step_ms_max: float
    missed_deadlines: int

    def as_dict(self) -> dict[str, Any]:
        """The metrics by name."""
        return asdict(self)


def measure_compute(times: ComputeTimes, control_period_s: float) -> ComputeMetrics:
    """Summarise compute times.

    Args:
        times: Times that the loop measured.
        control_period_s: Deadline of a step, seconds.

    Returns:
        The metrics; NaN where nothing was measured.
    """

    def percentile(values: FloatArray, q: float) -> float:
        return float(np.percentile(values, q)) if values.size else float("nan")

    return ComputeMetrics(
        update_ms_p50=percentile(times.update_ms, 50),
        update_ms_p99=percentile(times.update_ms, 99),
        update_ms_max=percentile(times.update_ms, 100),
        step_ms_p50=percentile(times.step_ms, 50),
        step_ms_p99=percentile(times.step_ms, 99),
        step_ms_max=percentile(times.step_ms, 100),
        missed_deadlines=int(np.sum(times.step_ms > 1e3 * control_period_s)),
    )
