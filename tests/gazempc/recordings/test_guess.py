"""Tables without a mapping: the guess reads the walk that was written."""

import numpy as np
import pytest
from builders.exports import Walk, in_axes, quat_in_axes
from scipy.spatial.transform import Rotation
from test_columns import same_head, same_turn, write

from gazempc.errors import RecordingError
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions

T, HEAD, PELVIS = Walk.times_s, Walk.head_m, Walk.pelvis_m
QUAT_XYZW = Walk.head.as_quat()
TWO = np.hstack([Walk.head.as_euler("xyz"), Walk.head.as_euler("xyz")])
SEEN = HEAD + np.array([1.0, 0.0, -1.2])  # from a sensor
TABLES = {
    "an index first": (["", "timestamp", "head_x", "head_y", "head_z"], T, T, HEAD),
    "ROS, ns, mm, turn": (
        ["stamp_ns", *(f"pose.position.{c}" for c in "xyz"), *(f"pose.orientation.{c}" for c in "xyzw")],
        1e9 * (1.7e9 + T), 1000 * HEAD, QUAT_XYZW,
    ),
    "units in brackets": (["Time (s)", "Head X [mm]", "Head Y [mm]", "Head Z [mm]"], T, 1000 * HEAD),
    "bare letters, ms": (["time_ms", "x", "y", "z"], 1000 * T, HEAD),
    "y up": (["time", "HeadPosX", "HeadPosY", "HeadPosZ"], T, in_axes("y-up", HEAD)),
    "optical": (["time", "face_x", "face_y", "face_z"], T, in_axes("optical", SEEN)),
    "a sensor's, x forward": (["time", "face_x", "face_y", "face_z"], T, SEEN),
    "PlotJuggler": (["__time", *(f"/face/pose/position/{c}" for c in "xyz")], 1.7e9 + T, HEAD),
    "seconds, nanoseconds": (["sec", "nanosec", "position_x", "position_y", "position_z"], T // 1, T % 1 * 1e9, HEAD),
    "ROS 1, seconds and nanoseconds, turn": (
        ["secs", "nsecs", *(f"position.{c}" for c in "xyz"), *(f"orientation.{c}" for c in "xyzw")],
        T // 1, T % 1 * 1e9, HEAD, QUAT_XYZW,
    ),
    "a time in two units": (["t_sec", "t_nsec", "x", "y", "z"], T, 1e9 * T, HEAD),
    "scalar first, turn": (
        ["time", *(f"head_{c}" for c in "xyz"), *(f"head_q{c}" for c in "wxyz")], T, HEAD, Walk.quat_wxyz("head"),
    ),
    "Rotation, turn": (
        ["Time", *(f"Position.{c}" for c in "XYZ"), *(f"Rotation.{c}" for c in "XYZW")], T, HEAD, QUAT_XYZW,
    ),
    "bare letters of a quaternion, y up, turn": (
        ["time", "px", "py", "pz", "qx", "qy", "qz", "qw"],
        T, in_axes("y-up", HEAD), np.roll(quat_in_axes("y-up", Walk.head), -1, axis=1),
    ),
    "quaternions of head and pelvis, turn": (
        ["time", *(f"{part}_{c}" for part in ("head", "pelvis") for c in ("x", "y", "z", "qx", "qy", "qz", "qw"))],
        T, HEAD, QUAT_XYZW, PELVIS, Walk.pelvis.as_quat(),
    ),
    "a quaternion of a robot, too, turn": (
        ["time", "head_x", "head_y", "head_z", *(f"{part}_q{c}" for part in ("robot", "head") for c in "xyzw")],
        T, HEAD, Walk.pelvis.as_quat(), QUAT_XYZW,
    ),
    "angles of the head in rad, turn": (
        ["time", *(f"head_{c}" for c in ("x", "y", "z", "roll", "pitch", "yaw"))], T, HEAD, Walk.head.as_euler("xyz"),
    ),
    "Euler angles in degrees, y up, turn": (
        ["time", "tx", "ty", "tz", "rx", "ry", "rz"], T, in_axes("y-up", HEAD),
        Rotation.from_quat(quat_in_axes("y-up", Walk.head), scalar_first=True).as_euler("xyz", degrees=True),
    ),
    "yaw, turn": (["t", "x", "y", "z", "head_yaw_deg"], T, HEAD, np.degrees(Walk.travel_rad + 0.3)),
    "angles, turn": (
        ["t", "x", "y", "z", "roll", "pitch", "yaw"], T, HEAD, 0 * T, 0 * T, np.degrees(Walk.travel_rad + 0.3),
    ),
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
    if name.endswith("turn"):
        same_turn(guessed)
    if "pelvis" in name:
        same_turn(guessed, "pelvis")
    if name.startswith("a body"):
        np.testing.assert_allclose(guessed.truth.pelvis_position_m, PELVIS, atol=1e-9)
    # What is proposed can be pasted.
    pasted = str(caught.value).partition('--reading.columns "')[2].partition('"')[0]
    again = load(path, ReadOptions(columns=pasted))
    np.testing.assert_array_equal(again.truth.head_position_m, guessed.truth.head_position_m)


def test_undetermined_parts_are_named(tmp_path):
    path = write(tmp_path / "a.csv", ["frame", "id", "x", "y"], np.arange(90.0), 0 * T + 3, HEAD[:, :2])
    with pytest.raises(RecordingError, match=r"30 frames a second is a guess; the file has no height: 1\.6 m stands"):
        load(path)
    same_head(load(path, ReadOptions(guess=True)), np.column_stack([HEAD[:, :2], 0 * T + 1.6]))


ORIENTATIONS = {
    "order unknown": (["q0", "q1", "q2", "q3"], QUAT_XYZW, "q0, q1, q2, q3"),
    "of two trackers": (
        [f"{k}_{c}" for k in ("helmet", "glasses") for c in ("roll", "pitch", "yaw")],
        TWO,
        "helmet_roll",
    ),
    "no unit quaternion": (["qx", "qy", "qz", "qw"], 2.0 * QUAT_XYZW, "qx, qy, qz, qw"),
    "of the spine": ([f"spine_rot_{c}" for c in "xyz"], TWO[:, :3], "spine_rot_x, spine_rot_y, spine_rot_z"),
    "of two heads": ([f"{k}_q{c}" for k in ("head", "face") for c in "xyzw"], np.tile(QUAT_XYZW, 2), "head_qx"),
    "yaw and pitch": (["yaw", "pitch"], TWO[:, :2], "pitch"),
}


@pytest.mark.parametrize("name", ORIENTATIONS)
def test_an_orientation_without_a_guess_is_named(tmp_path, name):
    header, columns, named = ORIENTATIONS[name]
    path = write(tmp_path / "a.csv", ["t", "x", "y", "z", *header], T, HEAD, columns)
    with pytest.raises(RecordingError, match=rf"orientations left out: '{named}.*head_q or head_euler"):
        load(path)
    assert any("left out" in note for note in load(path, ReadOptions(guess=True)).notes)


def test_roll_pitch_and_yaw_need_z_up(tmp_path):
    header = ["stamp", *(f"head_{c}" for c in ("x", "y", "z", "roll", "pitch", "yaw"))]
    path = write(tmp_path / "a.csv", header, T, in_axes("y-up", HEAD), TWO[:, :3])
    with pytest.raises(RecordingError, match="orientations left out: 'head_roll, head_pitch, head_yaw'"):
        load(path)


@pytest.mark.parametrize("header", [["t", "a", "b", "c"], ["t", "left_x", "b", "c"], ["k", "x", "y", "z"]])
def test_nothing_to_guess(tmp_path, header):
    with pytest.raises(RecordingError, match="no columns that could be the time and one head"):
        load(write(tmp_path / "a.csv", header, T, HEAD), ReadOptions(guess=True))


def test_two_heads_are_not_guessed(tmp_path):
    header = ["t", *(f"head{k}_{c}" for k in (1, 2) for c in "xyz")]
    with pytest.raises(RecordingError, match="no columns that could be the time and one head"):
        load(write(tmp_path / "a.csv", header, T, HEAD, HEAD), ReadOptions(guess=True))
