"""The recorder: what is written once."""

import numpy as np
from builders.loop import NECK, make_recorder
from builders.replays import run_info


def test_an_event_that_lasts_is_written_once():
    recorder = make_recorder()
    for k in range(100):
        recorder.event(k * NECK.control_period_s, "stale_plan")
    recorder.event(3.0, "stale_plan")
    log, _ = recorder.finish(run_info(), lambda t: np.zeros((len(t), 3)))
    assert log.event_time_s.tolist() == [0.0, 3.0]
