"""Priorities while commands are sent, and a predictor in a separate process."""

import gc
import multiprocessing
import os
import threading

import numpy as np
import pytest
from builders.faults import Exits

from gazempc.live.process import IsolatedPredictor, real_time_priority
from predictors import ConstantVelocity, HeadObservation, OutOfOrderError


def policy(thread):
    kind = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    return kind, os.sched_getparam(thread).sched_priority


def may():
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


@pytest.mark.skipif(not may(), reason="real-time priorities require a higher limit rtprio")
def test_the_command_thread_has_priority_and_all_priorities_are_restored():
    ended, found = threading.Event(), []
    other = threading.Thread(target=ended.wait)
    other.start()
    with real_time_priority():
        found += [policy(0), policy(other.native_id)]
        later = threading.Thread(target=lambda: found.append(policy(0)))
        later.start()
        later.join()
    found += [policy(0), policy(other.native_id)]
    ended.set()
    other.join()
    assert found == [(os.SCHED_RR, 20), (os.SCHED_RR, 10), *[(os.SCHED_OTHER, 0)] * 3]


def seen(time_s):
    return HeadObservation(time_s, np.array([2.0, time_s, 0.4]))


@pytest.mark.slow
def test_a_predictor_process_forecasts_and_raises_as_in_process_and_ends_with_its_proxy():
    others = set(multiprocessing.active_children())
    local, remote = ConstantVelocity(), IsolatedPredictor(Exits)
    (process,) = set(multiprocessing.active_children()) - others
    for predictor in (local, remote):
        for k in range(6):
            predictor.update(seen(k / 30))
        with pytest.raises(OutOfOrderError):
            predictor.update(seen(0.0))
    times_s = np.array([0.3, 0.6])
    with pytest.raises(SystemExit, match="bye"):
        remote.forecast(times_s)
    np.testing.assert_array_equal(remote.forecast(times_s).means_base_m, local.forecast(times_s).means_base_m)
    assert remote.rejections_in_a_row == local.rejections_in_a_row
    del predictor, remote
    gc.collect()  # exceptions hold references to their frames
    process.join(20.0)
    assert not process.is_alive()


class WithLockError(Exception):
    def __init__(self):
        super().__init__("locked")
        self.lock = threading.Lock()


class WithTwoError(Exception):
    def __init__(self, one, other):
        super().__init__(f"{one} and {other}")


class RaisesOnce(ConstantVelocity):
    def __init__(self):
        super().__init__()
        self.errors = [WithLockError(), WithTwoError("this", "that")]

    def update(self, observation):
        super().update(observation)
        if self.errors:
            raise self.errors.pop(0)


@pytest.mark.slow
def test_an_exception_that_has_no_copy_arrives_as_its_text_and_the_process_continues():
    predictor = IsolatedPredictor(RaisesOnce)
    for k, text in enumerate(("WithLockError: locked", "WithTwoError: this and that")):
        with pytest.raises(RuntimeError, match=text):
            predictor.update(seen(k / 30))
    predictor.update(seen(0.1))
    assert np.isfinite(predictor.forecast(np.array([0.3])).means_base_m).all()
