"""A predictor in a process of its own: the same forecasts, its exceptions here, and its end with the run."""

import json
import multiprocessing
import sys

import numpy as np
import pytest

from gazempc.live.isolated import IsolatedPredictor
from gazempc.live.session import main
from predictors import ConstantVelocity, HeadObservation, OutOfOrderError


def seen(time_s):
    return HeadObservation(time_s, np.array([2.0, time_s, 0.4]))


@pytest.mark.slow
def test_it_forecasts_and_raises_as_it_does_here():
    here, there = ConstantVelocity(), IsolatedPredictor(ConstantVelocity)
    for predictor in (here, there):
        for k in range(6):
            predictor.update(seen(k / 30))
        with pytest.raises(OutOfOrderError):
            predictor.update(seen(0.0))
    times_s = np.array([0.3, 0.6])
    np.testing.assert_array_equal(there.forecast(times_s).means_base_m, here.forecast(times_s).means_base_m)
    assert there.rejections_in_a_row == here.rejections_in_a_row


class Exits(ConstantVelocity):
    """Calls sys.exit once."""

    forecasts = 0

    def forecast(self, times_s):
        self.forecasts += 1
        if self.forecasts == 1:
            sys.exit("bye")
        return super().forecast(times_s)


@pytest.mark.slow
def test_sys_exit_there_is_raised_here_and_the_process_goes_on():
    there = IsolatedPredictor(Exits)
    there.update(seen(0.0))
    with pytest.raises(SystemExit, match="bye"):
        there.forecast([0.3])
    assert there.forecast([0.3]).means_base_m.shape == (1, 3)


@pytest.mark.slow
def test_its_process_ends_with_it():
    others = set(multiprocessing.active_children())
    there = IsolatedPredictor(ConstantVelocity)
    (process,) = set(multiprocessing.active_children()) - others
    del there
    process.join(20.0)
    assert not process.is_alive()


@pytest.mark.slow
def test_a_run_with_it(tmp_path):
    words = ["--source", "replay", "--robot", "simulated", "--isolate", "predictor", "--duration-s", "2"]
    assert main([*words, "--no-figures", "--out", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["used"] > 30
    assert not {"forecast_failed", "part_slow"} & set(summary["events"])


def test_several_people_are_refused(tmp_path, capsys):
    words = ["--source", "replay", "--isolate", "predictor", "--attend", "nearest", "--out", str(tmp_path)]
    assert main(words) == 2
    assert "--isolate: accepted for one person" in capsys.readouterr().err
