"""The recorder: lasting events are recorded once; columns are one array of all chunks."""

import numpy as np
import pytest
from builders.loop import NECK, make_recorder
from builders.replays import run_info

from gazempc.loop.recorder import JointColumns
from gazempc.types import JointState


def test_a_lasting_event_is_recorded_once():
    recorder = make_recorder()
    for k in range(100):
        recorder.event(k * NECK.control_period_s, "stale_plan")
    recorder.event(3.0, "stale_plan")
    log, _ = recorder.finish(run_info(), lambda t: np.zeros((len(t), 3)))
    assert log.event_time_s.tolist() == [0.0, 3.0]


@pytest.mark.parametrize(("rows", "joints"), [(0, 2), (128, 5), (129, 2), (1000, 5)])
def test_readings_are_rows_of_three_columns(rows, joints):
    rng = np.random.default_rng(0)
    states = [JointState(0.005 * k, rng.normal(size=joints), rng.normal(size=joints)) for k in range(rows)]
    states = [None if k % 7 == 3 else state for k, state in enumerate(states)]
    columns = JointColumns(joints, states)
    assert len(columns) == rows
    nothing = JointState(np.nan, np.full(joints, np.nan), np.full(joints, np.nan))
    known = [nothing if state is None else state for state in states]
    for name, found in zip(("time_s", "position_rad", "velocity_rad_s"), columns.arrays(), strict=True):
        expected = np.array([getattr(state, name) for state in known])
        assert np.array_equal(found.ravel(), expected.ravel(), equal_nan=True)
