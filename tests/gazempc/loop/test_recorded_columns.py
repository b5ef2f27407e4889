"""Columns are what one array of all rows would be, however many pieces there are."""

import numpy as np
import pytest

from gazempc.loop.columns import JointColumns, PackedRows
from gazempc.types import JointState


@pytest.mark.parametrize("rows", [0, 1, 127, 128, 129, 1000])
@pytest.mark.parametrize("joints", [2, 5])
def test_readings_are_rows_of_three_columns(rows, joints):
    rng = np.random.default_rng(0)
    states = [JointState(0.005 * k, rng.normal(size=joints), rng.normal(size=joints)) for k in range(rows)]
    states = [None if k % 7 == 3 else state for k, state in enumerate(states)]
    columns = JointColumns(joints, states)
    assert len(columns) == rows
    nothing = JointState(np.nan, np.full(joints, np.nan), np.full(joints, np.nan))
    known = [nothing if state is None else state for state in states]
    times_s, position_rad, velocity_rad_s = columns.arrays()
    assert np.array_equal(times_s, np.array([s.time_s for s in known]), equal_nan=True)
    assert position_rad.shape == velocity_rad_s.shape == (rows, joints)
    assert np.array_equal(position_rad.ravel(), np.array([s.position_rad for s in known]).ravel(), equal_nan=True)
    assert np.array_equal(velocity_rad_s.ravel(), np.array([s.velocity_rad_s for s in known]).ravel(), equal_nan=True)


def test_no_append_packs_more_than_a_piece():
    """Whoever records is a tick: what it packs must not grow with the log."""
    packed = []

    def pack(rows):
        packed.append(len(rows))
        return (np.array(rows),)

    columns = PackedRows(pack)
    for k in range(1000):
        columns.append(float(k))
    assert max(packed) <= 128
    (values,) = columns.arrays()
    assert np.array_equal(values, np.arange(1000.0))
    assert sum(packed) == 1000
