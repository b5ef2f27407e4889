"""Tables that nobody has described: what would be guessed reads the walk that was written."""

import numpy as np
import pytest
from builders.exports import Walk, in_axes
from test_columns import same_head, same_turn, write

from gazempc.errors import RecordingError
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions

T, HEAD, PELVIS = Walk.times_s, Walk.head_m, Walk.pelvis_m
QUAT_XYZW = Walk.head.as_quat()
SEEN = HEAD + np.array([1.0, 0.0, -1.2])  # from a sensor
TABLES = {
    "an index first": (["", "timestamp", "head_x", "head_y", "head_z"], T, T, HEAD),
    "ROS, ns and mm": (
        ["stamp_ns", *(f"pose.position.{c}" for c in "xyz"), *(f"pose.orientation.{c}" for c in "xyzw")],
        1e9 * (1.7e9 + T), 1000 * HEAD, QUAT_XYZW,
    ),
    "units in brackets": (["Time (s)", "Head X [mm]", "Head Y [mm]", "Head Z [mm]"], T, 1000 * HEAD),
    "bare letters, ms": (["time_ms", "x", "y", "z"], 1000 * T, HEAD),
    "y up": (["time", "HeadPosX", "HeadPosY", "HeadPosZ"], T, in_axes("y-up", HEAD)),
    "optical": (["time", "face_x", "face_y", "face_z"], T, in_axes("optical", SEEN)),
    "a sensor's, x forward": (["time", "face_x", "face_y", "face_z"], T, SEEN),
    "PlotJuggler": (["__time", *(f"/face/pose/position/{c}" for c in "xyz")], 1.7e9 + T, HEAD),
    "angles": (["t", "x", "y", "z", "roll", "pitch", "yaw"], T, HEAD, 0 * T, 0 * T, np.degrees(Walk.travel_rad + 0.3)),
    "a body, y up, cm": (
        ["Frame", "Time", *(f"{part}_{c}" for part in ("Head", "Hips", "LeftHand") for c in "XYZ")],
        np.arange(90.0), T, *(100 * in_axes("y-up", p) for p in (HEAD, PELVIS, PELVIS)),
    ),
    "commas in names": (["time, s", "head, x", "head, y", "head, z"], T, HEAD),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_natural_headers(tmp_path, name):
    header, *columns = TABLES[name]
    header = [f'"{cell}"' if "," in cell else cell for cell in header]
    path = write(tmp_path / "a.csv", header, *columns)
    with pytest.raises(RecordingError, match=r"a guess: --reading\.columns ") as caught:
        load(path)
    guessed = load(path, ReadOptions(guess=True))
    same_head(guessed, SEEN if name in ("optical", "a sensor's, x forward") else HEAD)
    np.testing.assert_allclose(guessed.times_s - guessed.times_s[0], T, atol=1e-6)
    if name == "angles":
        same_turn(guessed)
    if name.startswith("a body"):
        np.testing.assert_allclose(guessed.truth.pelvis_position_m, PELVIS, atol=1e-9)
    # What is proposed can be pasted.
    pasted = str(caught.value).partition('--reading.columns "')[2].partition('"')[0]
    again = load(path, ReadOptions(columns=pasted))
    np.testing.assert_array_equal(again.truth.head_position_m, guessed.truth.head_position_m)


@pytest.mark.parametrize("header", [["t", "a", "b", "c"], ["t", "left_x", "b", "c"], ["k", "x", "y", "z"]])
def test_nothing_to_guess(tmp_path, header):
    with pytest.raises(RecordingError, match="no columns that could be the time and one head"):
        load(write(tmp_path / "a.csv", header, T, HEAD), ReadOptions(guess=True))


def test_two_heads_are_not_guessed(tmp_path):
    header = ["t", *(f"head{k}_{c}" for k in (1, 2) for c in "xyz")]
    with pytest.raises(RecordingError, match="no columns that could be the time and one head"):
        load(write(tmp_path / "a.csv", header, T, HEAD, HEAD), ReadOptions(guess=True))
