"""A recording from arrays: what is given is kept, what is left out is not known, what is wrong is named."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gazempc as gz
from gazempc.errors import RecordingError

TIMES_S = np.arange(120) / 30.0
HEAD_M = np.stack([0.5 * TIMES_S, 1.0 + 0.0 * TIMES_S, 1.7 + 0.02 * np.sin(11.0 * TIMES_S)], axis=1)


def test_what_is_given_is_kept():
    quats = Rotation.from_euler("z", np.linspace(0.0, 90.0, 120)[:, None], degrees=True).as_quat(scalar_first=True)
    pelvis_m = HEAD_M - [0.1, 0.0, 0.7]
    made = gz.recording_from_arrays(
        "anna_1", TIMES_S.tolist(), HEAD_M.tolist(), in_base_frame=True,
        head_quat_wxyz=quats, pelvis_position_m=pelvis_m, pelvis_quat_wxyz=[0.0, 0.0, 0.0, 1.0],
    )  # fmt: skip
    np.testing.assert_array_equal(made.times_s, TIMES_S)
    np.testing.assert_array_equal(made.truth.head_position_m, HEAD_M)
    np.testing.assert_allclose(made.truth.head_quat_wxyz, quats)
    np.testing.assert_array_equal(made.truth.pelvis_position_m, pelvis_m)
    np.testing.assert_array_equal(made.truth.pelvis_quat_wxyz, np.tile([0, 0, 0, 1], (120, 1)))
    assert (made.name, made.labels.subject, made.has_robot) == ("anna_1", "anna", True)
    assert made.truth.valid.all()
    assert not gz.recording_from_arrays("anna", TIMES_S, HEAD_M).has_robot


def spoilt(array, row, value):
    other = np.array(array)
    other[row] = value
    return other


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"times_s": TIMES_S[:-1]}, "head_position_m: its shape is (120, 3)"),
        ({"times_s": TIMES_S[:, None]}, "times_s: its shape is (120, 1)"),
        ({"times_s": spoilt(TIMES_S, 7, 0.0)}, "row 7: the time stamp 0.0 follows"),
        ({"times_s": "now"}, "times_s: these are no numbers"),
        ({"head_position_m": spoilt(HEAD_M, 5, np.nan)}, "row 5"),
        ({"head_position_m": 1e3 * HEAD_M}, "looks like millimetres"),
        ({"head_quat_wxyz": [1.0, 1.0, 0.0, 0.0]}, "head_quat_wxyz: not a unit quaternion"),
        ({"pelvis_quat_wxyz": np.zeros((3, 4))}, "pelvis_quat_wxyz: its shape is (3, 4)"),
    ],
)
def test_what_is_wrong_is_named(arguments, named):
    with pytest.raises(RecordingError) as raised:
        gz.recording_from_arrays(**{"name": "mine", "times_s": TIMES_S, "head_position_m": HEAD_M, **arguments})
    assert str(raised.value).startswith("mine: ")
    assert named in str(raised.value)
