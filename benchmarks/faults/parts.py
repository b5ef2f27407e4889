"""Parts that misbehave in a live run on the real clock."""

from __future__ import annotations

import math
import timeit
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.faults.machine import GapMs
from benchmarks.faults.runs import Count, Wrong, watch
from benchmarks.faults.wrongs import FAMILIES, ISOLATED, hold_lock
from gazempc.live.isolated import IsolatedPredictor
from gazempc.live.run import LiveRun
from gazempc.live.settings import LiveSettings
from gazempc.live.setup import build
from predictors import ConstantVelocity, Forecast, HeadObservation

_FROM_S = 0.5
_WALK = "subject03_R4"


class Holding(ConstantVelocity):
    """A predictor that holds the lock for long now and then."""

    forecasts = 0

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """See `predictors.predictor.Predictor.forecast`."""
        self.forecasts += 1
        if self.forecasts % 50 == 0:
            hold_lock(None)
        return super().forecast(times_s)


def run_part(family: str, kind: str, machine_gap_ms: GapMs, seconds: float = 1.8) -> Count:
    """One run.

    Args:
        family: One of `FAMILIES`.
        kind: One of that family.
        machine_gap_ms: See `benchmarks.faults.machine.control`.
        seconds: How long.

    Returns:
        What came of it.
    """
    part, _, method = family.partition(",")[0].partition(".")
    # Parts that are quick to make, a hundred times.
    settings = LiveSettings(source="replay", replay=_WALK, out=Path())
    setup = build(settings.model_copy(update={"controller": "lookahead", "predictor": "constant_velocity"}))
    if family == ISOLATED:
        setup = replace(setup, predictor=IsolatedPredictor(Holding))
    wrong_from_s, change = [math.inf], FAMILIES[family][kind]

    def begin(run: LiveRun) -> None:
        wrong_from_s[0] = setup.clock.now_s() + _FROM_S

    def later(answer: object) -> object:
        return change(answer) if setup.clock.now_s() > wrong_from_s[0] else answer

    names = ("robot", "source", "controller", "predictor")
    parts = {name: Wrong(getattr(setup, name), method * (part == name.capitalize()), later) for name in names}
    spoilt = replace(setup, **parts)  # type: ignore[arg-type]
    return watch(spoilt, (family, kind), seconds, machine_gap_ms, begin)[0]


def isolation_ms(calls: int = 2000) -> tuple[float, float]:
    """What a process of its own costs: time of a forecast there less the time of one here, milliseconds.

    Args:
        calls: How many.

    Returns:
        Median, and 99th percentile of the time there less the median here.
    """
    times_s, took_ms = 0.1 + 0.02 * np.arange(25), []
    for predictor in (ConstantVelocity(), IsolatedPredictor(ConstantVelocity)):
        predictor.update(HeadObservation(0.0, np.array([2.0, 0.0, 0.4])))
        took_ms.append(1e3 * np.array(timeit.repeat(partial(predictor.forecast, times_s), number=1, repeat=calls)))
    here, there = took_ms
    return tuple(round(float(np.percentile(there, p) - np.median(here)), 2) for p in (50, 99))  # type: ignore[return-value]
