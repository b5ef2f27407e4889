"""A log that was written before, measured again."""

from __future__ import annotations

import numpy as np

from gazempc.results.compute import measure_compute
from gazempc.results.log import ComputeTimes, Log
from gazempc.results.metrics import measure
from gazempc.results.repeats import Repeats
from gazempc.results.report import make_rows


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
