"""A predictor in a process of its own: the same forecasts, its exceptions here, and its end with the run."""

import gc
import multiprocessing
import sys

import numpy as np
import pytest

from gazempc.live.isolated import IsolatedPredictor
from predictors import ConstantVelocity, HeadObservation, OutOfOrderError


def seen(time_s):
    return HeadObservation(time_s, np.array([2.0, time_s, 0.4]))


class Exits(ConstantVelocity):
    """Calls sys.exit once."""

    forecasts = 0

    def forecast(self, times_s):
        self.forecasts += 1
        if self.forecasts == 1:
            sys.exit("bye")
        return super().forecast(times_s)


@pytest.mark.slow
def test_it_forecasts_and_raises_as_it_does_here_and_its_process_ends_with_it():
    others = set(multiprocessing.active_children())
    here, there = ConstantVelocity(), IsolatedPredictor(Exits)
    (process,) = set(multiprocessing.active_children()) - others
    for predictor in (here, there):
        for k in range(6):
            predictor.update(seen(k / 30))
        with pytest.raises(OutOfOrderError):
            predictor.update(seen(0.0))
    times_s = np.array([0.3, 0.6])
    with pytest.raises(SystemExit, match="bye"):
        there.forecast(times_s)
    np.testing.assert_array_equal(there.forecast(times_s).means_base_m, here.forecast(times_s).means_base_m)
    assert there.rejections_in_a_row == here.rejections_in_a_row
    del predictor, there
    gc.collect()  # exceptions hold what raised them
    process.join(20.0)
    assert not process.is_alive()
